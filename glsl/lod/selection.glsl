// Selection of a level of detail: the table of pages, the pages in view, and the state of a selection.
// src/render/lod/selection.rs explains the search of an error limit, src/lod/mod.rs the words.

const uint PARTS = 8;        // equal parts of a page's nodes, in order of their errors
const uint ROUNDS = 5;       // of a search
const uint CANDIDATES = 7;   // limits per round
const uint SEARCHES = 2;     // by predicted error, and by the number of nodes
const uint SAMPLES = 8;      // nodes of a page that are tested against the image
const uint NO_PAGE = 4294967295;
const uint NO_SLOT = 4294967295;

// The bounds of a page, in units of the scene.
struct PageBox {
    vec3 low;          // of means
    vec3 high;
    float reach;       // largest distance of a drawn point from its mean; negative if nothing is drawn
    float margin_px;   // added to the reach in the image, for the low-pass filter of splats
    vec3 lod_low;      // the box of its group: pixel widths are taken at its nearest point
    vec3 lod_high;
    float per_width_squared;  // 1 / reference width^2: up to this pixel width, errors are fully visible
    float first_view;  // the number of the first placed view of its scene
    float views;       // the number of its placed views
};

// The errors of a page as codes, two per word, ascending.
struct PageErrors {
    uint parent;  // a page of the group with the parents of its nodes, or NO_PAGE
    uint count;   // number of nodes
    uint level;   // 0 for pages of the scene
    uint least_error;
    uint errors[PARTS / 2];    // the largest error in each eighth of the nodes
    uint parent_errors[PARTS / 2];  // the same for the errors of parents
    uint squared_errors[PARTS / 2];  // for each eighth: the mean squared error against the scene
    uint samples[SAMPLES];     // positions of nodes in the box of their means, ten bits per axis
};

// The state of a selection, during the search and afterwards. Numbers of 64 bits are a low and a high word. The unit of
// nodes is 1/SAMPLES; that of squared errors is 2^-48 of an image with an error of 1 everywhere.
struct SelectionState {
    uint in_view;   // pages in view, also those beyond the capacity of their list
    uint selected;  // pages in the draw list
    uint missing;   // selected pages that are not resident; of streamed frames, pages drawn coarser than selected
    uint requested;  // missing pages of at least the minimum priority, also those beyond max_requests
    uint limit_squared;  // bits of a float: error per saved node, in pixels times colours
    uint nodes[2];
    uint squared_error[2];
    uvec3 page_dispatch;  // workgroups over the quarters of the selected pages
    uint sums[ROUNDS * CANDIDATES * SEARCHES * 2];
};

// The stop depths of a picture of the same size and focal length.
struct Occlusion {
    float factor_squared;  // of the error limits of hidden groups; 1: there are no stop depths
    uint is_of_this_camera;  // 0: the camera has moved since
    uint block_height;  // px
    uvec2 bins;
};

// A page in view, packed in one element of the list `in_view`.
struct PageInView {
    uint page;
    bool is_drawn;  // it may touch the rows that are drawn
    uint view;    // its placed view
    uint weight;  // number of its samples in the image, at least 1
    vec2 widths;  // squared factors of an error limit: for its nodes, for their parents
};
const uint WEIGHT_SHIFT = 25, PAGE_BITS = 31;

uvec4 packed(PageInView page) {
    uint page_and_flag = page.page | uint(page.is_drawn) << PAGE_BITS;
    return uvec4(page_and_flag, page.view | page.weight << WEIGHT_SHIFT, floatBitsToUint(page.widths));
}

PageInView page_in_view_of(uvec4 element) {
    uint view = bitfieldExtract(element.y, 0, int(WEIGHT_SHIFT));
    uint page = bitfieldExtract(element.x, 0, int(PAGE_BITS));
    return PageInView(page, element.x >> PAGE_BITS == 1, view, element.y >> WEIGHT_SHIFT, uintBitsToFloat(element.zw));
}
