// Makes the splat of a Gaussian: its projection, its colour, its depth key, and the bins that it touches, as one span
// per row of bins.
// Requires: the bindings and push constants of fast/project.comp, and as macros
//   VIEW             the camera, in the axes and units of the Gaussians
//   INDEX_OF(g)      the index by which Gaussian g is ordered among those of equal depth
//   IN_WORLD(depth) and NEAR, as depth_key.glsl says
//   ATTRIBUTES       if looks may show attributes: the macros of inspect/attributes.glsl are defined, too
//   RAYS             for pictures along rays, whose bindings and push constants are those of fast_rays/project.comp
#define LISTED (uvec2(BIN_COLUMNS, BIN_ROWS) * uvec2(BLOCK_WIDTH, push.block_height))
#include "shared/ellipse.glsl"
#include "shared/marks.glsl"
#include "shared/storage.glsl"
#ifdef RAYS
#include "fast_rays/projection.glsl"
#else
#define SPLAT Splat
#include "fast/splat.glsl"
#include "shared/cull_test.glsl"
#include "shared/projection.glsl"
#endif
#include "shared/depth_key.glsl"
#include "shared/spans.glsl"
#ifdef RAYS
#include "fast_rays/spans.glsl"
#else
#define WRITE_SPANS(splat, ellipse, rows, offset) write_spans(ellipse, rows, offset)
#endif
#ifdef ATTRIBUTES
#include "inspect/attributes.glsl"

// The integral of the weight of a splat over the picture, px^2.
float area_of(Splat splat) {
    const float PI = 3.14159265;
    return PI * LOG2_E / (splat.factor.x * splat.factor.z);
}
#endif

const bool SH_EARLY = SH_STORED_VECTORS <= 3;
shared uint survivors[PROJECT_CHUNK];
shared float depths[PROJECT_CHUNK];  // of the survivors
shared uint found;
shared uint splats_here, spans_here;  // new ones of the workgroup's current batch
shared uvec2 first;                   // indices of the first of these splats and spans

void make_splat(uint gaussian, float z, bool exists) {
    vec3 mean = exists ? uintBitsToFloat(bounds[gaussian].xyz) : vec3(0.0);
    precise vec3 p = (mean - VIEW.position_high) - VIEW.position_low;
    SPLAT splat;
    Ellipse ellipse = EMPTY_ELLIPSE;
    // If there are few words, they are loaded before it is certain that they are needed: they arrive while the splat is
    // projected.
    uvec4 stored[SH_VECTORS];
    if (SH_EARLY && exists) fetch_sh(gaussian, stored);
    if (exists) project(gaussian, p, z, splat, ellipse);
    uvec2 rows = tile_rows(ellipse, VIEW);  // first, count

    uint row_spans = rows.y > 1 ? rows.y : 0;
    // Any order is right, here and below: lists are sorted later, and spans are found through their range.
    uvec4 ballot = subgroupBallot(rows.y > 0);
    uint index = subgroupBallotExclusiveBitCount(ballot), offset = subgroupExclusiveAdd(row_spans);
    uint all_spans = subgroupAdd(row_spans);
    uvec2 mine = uvec2(0);
    if (subgroupElect()) {
        mine.x = atomicAdd(splats_here, subgroupBallotBitCount(ballot));
        if (all_spans > 0) mine.y = atomicAdd(spans_here, all_spans);
    }
    mine = subgroupBroadcastFirst(mine);
    barrier();
    if (lane() == 0) {
        first = uvec2(atomicAdd(counters.visible, splats_here), 0);
        if (spans_here > 0) {
            first.y = atomicAdd(counters.spans, spans_here);
            if (first.y + spans_here < first.y) atomicAdd(counters.listed_high, 1);  // the frame is refused
        }
        splats_here = spans_here = 0;
    }
    barrier();
    index += first.x + mine.x;
    offset += first.y + mine.y;
    bool kept = rows.y > 0 && index < push.visible_capacity;
    bool fits = row_spans == 0 || offset <= push.span_capacity && row_spans <= push.span_capacity - offset;
    if (!kept || !fits) rows.y = 0;
    WRITE_SPANS(splat, ellipse, rows.y > 1 ? rows : uvec2(0), offset);
    if (!kept) return;
    gaussian_from_splat[index] = INDEX_OF(gaussian);
    uint place = rows.y == 1 ? tile_span(ellipse, rows.x, VIEW.size_px) : offset;
    span_ranges[index] = uvec2(place, drawn_row(rows.x, VIEW) | rows.y << 16);
    depth_keys[index] = depth_key(mean, z);
    if (!SH_EARLY) fetch_sh(gaussian, stored);
    splat.colour = marked_colour(bounds[gaussian].w, stored_colour(stored, direction(p)));
#ifdef ATTRIBUTES
    if (ATTRIBUTE != NO_ATTRIBUTE) splat.colour = attribute_of(gaussian, mean, z, area_of(splat));
#endif
    splats[index * SPLAT_WORDS] = element(splat, 0);
    splats[index * SPLAT_WORDS + 1] = element(splat, 1);
    if (SPLAT_WORDS > 2) splats[index * SPLAT_WORDS + 2] = element(splat, 2);
    if (SPLAT_WORDS > 3) splats[index * SPLAT_WORDS + 3] = element(splat, 3);
}
