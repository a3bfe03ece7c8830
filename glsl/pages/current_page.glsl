// The current page of a dispatch and its view, and the Gaussian of an element of a compacted list, which counts 1024
// elements for every page of the draw list.
// Requires: page.glsl, draw_list[], push.first_page, push.focal_px, push.centre_px, push.size_px, push.band

View current_view;
float scale;
PageDraw page;

// Makes a page of the draw list the current page.
void set_current_page(uint number) {
    page = page_of(draw_list[push.first_page + number]);
    PlacedView placed = PLACED_VIEW(draw_list, page.view * VIEW_ELEMENTS);
    current_view = view_of(placed, push.focal_px, push.centre_px, push.size_px, push.band);
    scale = placed.scale;
}

// The Gaussian of an element. Its page becomes the current page.
uint gaussian_of_element(uint element) {
    set_current_page(element / PAGE);
    return page.slot * PAGE + element % PAGE;
}

#define IN_WORLD(depth) (scale * (depth))
#define NEAR push.near
