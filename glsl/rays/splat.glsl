// A Gaussian as rays meet it, and the tests of the rays that meet it. A pixel has a ray `d`, in view axes: a unit
// vector, or for a parallel lens (x, y, 1), the ray along z through (x, y). No stage knows a lens: it is in the rays of
// the pixels, in bounds of the rays of many pixels, and in the table of footprints, which the host makes in f64.

const uint FOOTPRINTS = 256;  // cells along a side of the table of footprints
const float EVERYWHERE = 1e15;  // longer than every chord

// A Gaussian as rays meet it. With s = (dot(u, d - centre), dot(v, d - centre)) and w = dot(q, d), its falloff, the
// -log2 of its greatest weight / opacity along the ray d, is |s|^2 / (w^2 + kappa |s|^2) where w > 0; where w <= 0 the
// ray leads away from it. src/reference/ray_splat.rs derives it.
struct RaySplat {
    vec3 centre;  // the direction of the mean, or (x, y, 1)
    vec3 u;
    vec3 v;
    vec3 q;
    float kappa;
    float opacity;
    vec3 colour;
    float chord;  // all rays that meet the splat end within this distance of `centre`
};

// The falloff at |s|^2 and w: beyond every limit where the ray leads away from the splat.
float falloff_of(float square, float w, float kappa) {
    return w > 0.0 ? square / (w * w + kappa * square) : EVERYWHERE;
}

// The falloff of a splat along a ray.
float falloff_along(RaySplat splat, vec3 ray) {
    vec3 e = ray - splat.centre;
    float s = dot(splat.u, e), t = dot(splat.v, e), w = dot(splat.q, ray);
    return falloff_of(s * s + t * t, w, splat.kappa);
}

// Two directions across a direction: away from the axis of the camera, and around it.
struct Across {
    vec3 normal;
    vec3 e1;
    vec3 e2;
};

Across across(vec3 normal) {
    float rho = length(normal.xy);
    vec2 azimuth = rho > 0.0 ? normal.xy / rho : vec2(1.0, 0.0);
    return Across(normal, vec3(normal.z * azimuth, -rho), vec3(-azimuth.y, azimuth.x, 0.0));
}

vec3 axis_u(Across of, vec3 factor) {
    return factor.x * of.e1 + factor.y * of.e2;
}

vec3 axis_v(Across of, vec3 factor) {
    return factor.z * of.e2;
}

vec3 depth_axis(Across of, vec2 gamma) {
    return of.normal - gamma.x * of.e1 - gamma.y * of.e2;
}

// What the test of a cone needs of a splat.
struct Reach {
    float slope;   // rays whose |s| is up to `slope` times w are met; negative: all rays with w > 0
    float across;  // s changes by at most this much per distance between rays
    float along;   // and w by this much
};

// `limit`: the largest falloff at which the splat is drawn.
float slope_of(float kappa, float limit) {
    float rest = 1.0 - kappa * limit;
    return rest > 1e-3 ? sqrt(limit / rest) * (1.0 + 1e-5) : -1.0;
}

Reach reach_of(RaySplat splat, float limit) {
    float across = sqrt(dot(splat.u, splat.u) + dot(splat.v, splat.v));
    return Reach(slope_of(splat.kappa, limit), across, length(splat.q));
}

// False only if no ray within `spread` of `middle` meets the splat.
// `precise`: stages that count and list tiles decide alike, and a cone within another is met only if that is met.
bool meets(RaySplat splat, Reach reach, vec3 middle, float spread) {
    precise vec3 e = middle - splat.centre;
    precise float square = dot(e, e), chord = splat.chord + spread;
    if (square > chord * chord) return false;
    precise float w = dot(splat.q, middle) + reach.along * spread;
    if (!(w > 0.0)) return false;
    precise float u = dot(splat.u, e), v = dot(splat.v, e);
    precise float s = u * u + v * v, most = reach.slope * w + reach.across * spread;
    return reach.slope < 0.0 || s <= most * most;
}
