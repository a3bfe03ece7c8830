// Pages of Gaussians as the stages draw them, and the placed views that they are seen from.
// src/render/pages/mod.rs explains the words.

const uint PAGE = 1024;   // Gaussians in a page, the last of which may be missing
const uint QUARTERS = 4;  // workgroups of project for a page

// A page that a dispatch draws, in one element of the buffer `listed`.
struct ListedPage {
    uint slot;    // its place in the planes of Gaussians: it begins at Gaussian slot * PAGE
    uint limits;  // of errors, as codes: of its nodes in the lower half, of their parents in the upper half
    uint view;    // its placed view
    uint filled;  // number of Gaussians
    bool has_indices;  // the indices of its Gaussians are in a plane, else they are their places
    uint notes;   // what looks show of it, as lod/page_attributes.glsl has it
};
const uint HAS_INDICES = 2147483648;  // the highest bit of the last word, whose lowest bits count the Gaussians
const uint COUNT_BITS = 11, NOTES_BITS = 20;

ListedPage page_of(uvec4 element) {
    uint filled = bitfieldExtract(element.w, 0, int(COUNT_BITS));
    uint notes = bitfieldExtract(element.w, int(COUNT_BITS), int(NOTES_BITS));
    return ListedPage(element.x, element.y, element.z, filled, (element.w & HAS_INDICES) != 0, notes);
}

// A camera in the axes and units of a placed scene; the rest of the camera is that of the frame. It takes VIEW_ELEMENTS
// elements of `listed`, which begins with the views. Behind them comes an element with the number of pages.
struct PlacedView {
    vec3 right;
    vec3 down;
    vec3 forward;
    vec3 forward_low;
    vec3 position_high;
    vec3 position_low;
    float near;
    float scale;  // world units per unit of the scene
};
const uint VIEW_ELEMENTS = 5;

PlacedView placed_view_of(vec4 a, vec4 b, vec4 c, vec4 d, vec4 e) {
    return PlacedView(a.xyz, vec3(a.w, b.xy), vec3(b.zw, c.x), c.yzw, d.xyz, vec3(d.w, e.xy), e.z, e.w);
}

View view_of(PlacedView placed, vec2 focal_px, vec2 centre_px, uvec2 size_px) {
    return View(placed.right, placed.down, placed.forward, placed.forward_low, placed.position_high,
        placed.position_low, focal_px, centre_px, size_px, placed.near);
}
