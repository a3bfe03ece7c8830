// Real spherical harmonics up to degree 3, the basis and signs of the original 3DGS (Kerbl et al. 2023).
const float C0 = 0.28209479177387814;
const float C1 = 0.4886025119029199;
const float C2[5] = float[5](
    1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396);
const float C3[7] = float[7](
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154,
    -0.4570457994644658, 1.445305721320277, -0.5900435899266435);

// Coefficients are packed without gaps into vec4 planes: coefficient i has floats 3 i to 3 i + 2.
const uint SH_PLANES = 12;

vec3 coefficient(vec4 planes[SH_PLANES], uint i) {
    uint first = 3 * i;
    return vec3(planes[first / 4][first % 4], planes[(first + 1) / 4][(first + 1) % 4], planes[(first + 2) / 4][(first + 2) % 4]);
}

// Colour in the unit direction `d`, not negative.
vec3 harmonics_colour(vec4 planes[SH_PLANES], uint degree, vec3 d) {
    vec3 colour = 0.5 + C0 * coefficient(planes, 0);
    if (degree >= 1) {
        colour += C1 * (-d.y * coefficient(planes, 1) + d.z * coefficient(planes, 2) - d.x * coefficient(planes, 3));
    }
    if (degree >= 2) {
        float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
        colour += C2[0] * d.x * d.y * coefficient(planes, 4);
        colour += C2[1] * d.y * d.z * coefficient(planes, 5);
        colour += C2[2] * (2.0 * zz - xx - yy) * coefficient(planes, 6);
        colour += C2[3] * d.x * d.z * coefficient(planes, 7);
        colour += C2[4] * (xx - yy) * coefficient(planes, 8);
    }
    if (degree >= 3) {
        float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
        colour += C3[0] * d.y * (3.0 * xx - yy) * coefficient(planes, 9);
        colour += C3[1] * d.x * d.y * d.z * coefficient(planes, 10);
        colour += C3[2] * d.y * (4.0 * zz - xx - yy) * coefficient(planes, 11);
        colour += C3[3] * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * coefficient(planes, 12);
        colour += C3[4] * d.x * (4.0 * zz - xx - yy) * coefficient(planes, 13);
        colour += C3[5] * d.z * (xx - yy) * coefficient(planes, 14);
        colour += C3[6] * d.x * (xx - 3.0 * yy) * coefficient(planes, 15);
    }
    return max(colour, 0.0);
}
