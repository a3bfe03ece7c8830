// What the stages of a cut share: the table of pages, codes of errors, and the state of the search for a limit.
// src/render/slabs/chooser.rs explains the search, src/levels/mod.rs the words.

const uint PARTS = 8;        // parts of a page, in the order of their errors
const uint ROUNDS = 5;       // of the search
const uint CANDIDATES = 7;   // limits that a round tries
const uint SEARCHES = 2;     // by predicted error, and by the number of nodes
const uint SAMPLES = 8;      // nodes of a page that are looked for in the picture
const uint NO_PAGE = 4294967295;
const uint NO_SLOT = 4294967295;

// Where a page lies, in units of the scene.
struct PageBox {
    vec3 low;          // of means
    vec3 high;
    float reach;       // nothing is drawn farther from its mean than this; negative if nothing is drawn at all
    float margin_px;   // and not farther than this in the picture, by what splats are widened
    vec3 judged_low;   // the box from which its nodes are judged
    vec3 judged_high;
    float per_detail_squared;  // 1 / detail^2: errors show whole in pixels up to the detail
};

// Errors in a page: codes, two in each word, ascending.
struct PageErrors {
    uint parent;  // the page with the box by which the parents of its nodes are judged, or NO_PAGE
    uint count;   // nodes
    uint level;   // 0 for pages of the scene
    uint least;   // the least own error
    uint errors[PARTS / 2];    // the largest own error of each eighth of the nodes
    uint parents[PARTS / 2];   // the same of the errors of parents
    uint energies[PARTS / 2];  // for each eighth by own errors: the mean squared error against the scene
    uint samples[SAMPLES];     // places of nodes in the box of their means, ten bits for each axis
};

// A cut while it is searched, and afterwards. Numbers of 64 bits come as a low and a high word. Nodes are counted in
// parts of 1/SAMPLES; squared errors in 2^-48 of a picture that is wrong by 1 everywhere.
struct CutState {
    uint seen;     // demand: pages in view; more than there is room for are not listed
    uint listed;   // pages of the cut
    uint missing;  // of these, those that are not in device memory; where pages are demanded, those drawn coarser
    uint demanded;  // demand: of these, pages of at least the priority that is asked for
    uint limit_squared;  // bits of a float: of the change per saved node, in pixels times colours
    uint nodes[2];
    uint energy[2];
    uvec3 over_pages;  // the dispatch over quarters of pages
    uint sums[ROUNDS * CANDIDATES * SEARCHES * 2];
};

// A page in view, in an element of the list of these.
struct SeenPage {
    uint page;
    uint view;      // its placed view
    uint weight;    // of its samples, those in the picture; at least 1
    vec2 widths;    // squares of what a limit is multiplied with: of this page, of that with its parents
};
const uint WEIGHT_SHIFT = 25;

uvec4 packed(SeenPage seen) {
    return uvec4(seen.page, seen.view | seen.weight << WEIGHT_SHIFT, floatBitsToUint(seen.widths));
}

SeenPage seen_page_of(uvec4 element) {
    uint view = bitfieldExtract(element.y, 0, int(WEIGHT_SHIFT));
    return SeenPage(element.x, view, element.y >> WEIGHT_SHIFT, uintBitsToFloat(element.zw));
}
