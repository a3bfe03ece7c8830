#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One workgroup in all: finds where the visible Gaussians of each chunk go.
// Before: `sums` has the counts of cull. After: `sums` has their exclusive sums; totals.visible and the dispatches over
// it are set.

layout(binding = 0, scalar) buffer Sums { uint sums[]; };                                   // [chunks]
layout(binding = 1, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 2, scalar) buffer DispatchesBlock { PortableDispatches dispatches; };
layout(push_constant, scalar) uniform Push {
    uint chunks;
    uint visible_capacity;
} push;

#include "portable/scan_in_place.glsl"

void main() {
    uint visible = scan_in_place(0, push.chunks);
    if (lane() == 0) {
        uint kept = min(visible, push.visible_capacity);
        totals.visible = visible;
        totals.visible_kept = kept;
        dispatches.over_visible = folded(div_up(kept, WORKGROUP));
        dispatches.sort_visible = folded(div_up(kept, SORT_CHUNK));
        dispatches.scan_visible = folded(div_up(kept, SCAN_CHUNK));
    }
}
