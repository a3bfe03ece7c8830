// Real spherical harmonics up to degree 4, the basis and signs of the original 3DGS (Kerbl et al. 2023).
const float C0 = 0.28209479177387814;
const float C1 = 0.4886025119029199;
const float C2[5] = float[5](
    1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396);
const float C3[7] = float[7](
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154,
    -0.4570457994644658, 1.445305721320277, -0.5900435899266435);
const float C4[9] = float[9](
    2.5033429417967046, -1.7701307697799304, 0.9461746957575601, -0.6690465435572892, 0.10578554691520431,
    -0.6690465435572892, 0.47308734787878004, -1.7701307697799304, 0.6258357354491761);

const uint SH_FUNCTIONS = 25;  // basis functions
// Coefficients are packed without gaps into vectors: coefficient i has floats 3 i to 3 i + 2.
const uint SH_VECTORS = 19;
// Planes of stored vectors that are bound. If they are too few, each has two vectors per Gaussian.
const uint SH_PLANES = 12;

vec3 coefficient(vec4 floats[SH_VECTORS], uint i) {
    uint first = 3 * i;
    return vec3(
        floats[first / 4][first % 4],
        floats[(first + 1) / 4][(first + 1) % 4],
        floats[(first + 2) / 4][(first + 2) % 4]);
}

// The values of the basis functions up to `degree` in the unit direction `d`; 0 for higher degrees.
float[SH_FUNCTIONS] harmonics_basis(uint degree, vec3 d) {
    float basis[SH_FUNCTIONS];
    for (uint i = 0; i < SH_FUNCTIONS; i++) basis[i] = 0.0;
    float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
    basis[0] = C0;
    if (degree >= 1) {
        basis[1] = -C1 * d.y;
        basis[2] = C1 * d.z;
        basis[3] = -C1 * d.x;
    }
    if (degree >= 2) {
        basis[4] = C2[0] * d.x * d.y;
        basis[5] = C2[1] * d.y * d.z;
        basis[6] = C2[2] * (2.0 * zz - xx - yy);
        basis[7] = C2[3] * d.x * d.z;
        basis[8] = C2[4] * (xx - yy);
    }
    if (degree >= 3) {
        basis[9] = C3[0] * d.y * (3.0 * xx - yy);
        basis[10] = C3[1] * d.x * d.y * d.z;
        basis[11] = C3[2] * d.y * (4.0 * zz - xx - yy);
        basis[12] = C3[3] * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
        basis[13] = C3[4] * d.x * (4.0 * zz - xx - yy);
        basis[14] = C3[5] * d.z * (xx - yy);
        basis[15] = C3[6] * d.x * (xx - 3.0 * yy);
    }
    if (degree >= 4) {
        basis[16] = C4[0] * d.x * d.y * (xx - yy);
        basis[17] = C4[1] * d.y * d.z * (3.0 * xx - yy);
        basis[18] = C4[2] * d.x * d.y * (6.0 * zz - xx - yy);
        basis[19] = C4[3] * d.y * d.z * (4.0 * zz - 3.0 * xx - 3.0 * yy);
        basis[20] = C4[4] * (8.0 * zz * (zz - 3.0 * xx - 3.0 * yy) + 3.0 * (xx + yy) * (xx + yy));
        basis[21] = C4[5] * d.x * d.z * (4.0 * zz - 3.0 * xx - 3.0 * yy);
        basis[22] = C4[6] * (xx - yy) * (6.0 * zz - xx - yy);
        basis[23] = C4[7] * d.x * d.z * (xx - 3.0 * yy);
        basis[24] = C4[8] * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy));
    }
    return basis;
}

layout(constant_id = 21) const bool FEATURES = false;  // sums are features: nothing is added, negative ones are kept

const vec3 NO_HARMONICS = vec3(FEATURES ? 0.0 : 0.5);  // the sum without coefficients

// The colour of a sum of spherical harmonics, whose channels are not negative, or the sum itself if it is a feature.
vec3 colour_of_sum(vec3 sum) {
    return FEATURES ? sum : max(sum, 0.0);
}

// The colour seen in the unit direction `d`.
vec3 harmonics_colour(vec4 floats[SH_VECTORS], uint degree, vec3 d) {
    float basis[SH_FUNCTIONS] = harmonics_basis(degree, d);
    vec3 colour = NO_HARMONICS;
    for (uint i = 0; i < (degree + 1) * (degree + 1); i++) colour += basis[i] * coefficient(floats, i);
    return colour_of_sum(colour);
}
