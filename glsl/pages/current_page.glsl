// Finds the Gaussian of an element of a compacted list, which counts 1024 Gaussians for every listed page, and the view
// that it is seen from.
// Requires: page.glsl, listed[], push.first_page, push.focal_px, push.centre_px, push.size_px

View seen;
float scale;
ListedPage page;

// Makes `number` the current page.
void turn_to(uint number) {
    page = page_of(listed[push.first_page + number]);
    uint view = page.view * VIEW_ELEMENTS;
    PlacedView placed = placed_view_of(uintBitsToFloat(listed[view]), uintBitsToFloat(listed[view + 1]),
        uintBitsToFloat(listed[view + 2]), uintBitsToFloat(listed[view + 3]), uintBitsToFloat(listed[view + 4]));
    seen = view_of(placed, push.focal_px, push.centre_px, push.size_px);
    scale = placed.scale;
}

// The Gaussian of an element; its page becomes the current one.
uint found_gaussian(uint element) {
    turn_to(element / PAGE);
    return page.slot * PAGE + element % PAGE;
}

#define IN_WORLD(depth) (scale * (depth))
#define NEAR push.near
