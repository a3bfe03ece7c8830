// The draw list: the pages that a dispatch draws, and the placed views it draws them for.
// src/render/pages/mod.rs explains the words.

const uint PAGE = 1024;   // capacity of a page, in Gaussians
const uint QUARTERS = 4;  // workgroups of project for a page

// A page that a dispatch draws, in one element of `draw_list`.
struct PageDraw {
    uint slot;    // its position in the planes: its first Gaussian is slot * PAGE
    uint error_limits;  // as codes: for its nodes in the lower half, for their parents in the upper half
    uint view;    // its placed view
    uint count;   // number of Gaussians
    bool has_indices;  // a plane has the indices of its Gaussians; otherwise these are their positions
    uint attributes;  // for inspection: lod/page_attributes.glsl
};
const uint HAS_INDICES = 2147483648;  // the highest bit of the last word; its lowest bits are the count
const uint COUNT_BITS = 11, ATTRIBUTE_BITS = 20;

PageDraw page_of(uvec4 element) {
    uint count = bitfieldExtract(element.w, 0, int(COUNT_BITS));
    uint attributes = bitfieldExtract(element.w, int(COUNT_BITS), int(ATTRIBUTE_BITS));
    return PageDraw(element.x, element.y, element.z, count, (element.w & HAS_INDICES) != 0, attributes);
}

// The camera of the frame in the axes and units of one placement of the scene. `draw_list` begins with these views,
// VIEW_ELEMENTS elements each, followed by one element with the number of pages, and the pages.
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

// The view that begins with an element of a list. A macro, since a shader cannot pass a buffer.
#define PLACED_VIEW(list, first) placed_view_of(uintBitsToFloat(list[first]), uintBitsToFloat(list[(first) + 1]), \
    uintBitsToFloat(list[(first) + 2]), uintBitsToFloat(list[(first) + 3]), uintBitsToFloat(list[(first) + 4]))

View view_of(PlacedView placed, vec2 focal_px, vec2 centre_px, uvec2 size_px, uint band) {
    return View(placed.right, placed.down, placed.forward, placed.forward_low, placed.position_high,
        placed.position_low, focal_px, centre_px, size_px, band, placed.near);
}
