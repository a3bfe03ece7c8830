#version 460
#include "shared/workgroup.glsl"
#include "portable/frame.glsl"
// One workgroup in all: finds where the instances of each chunk go.
// Before: `sums` from scan_sums, the instance demand from project.
// After: `sums` has exclusive sums; totals.listed_kept and the dispatches over instances are set.

layout(binding = 0, scalar) buffer Sums { uint sums[]; };                                   // [chunks]
layout(binding = 1, scalar) buffer TotalsBlock { Totals totals; };
layout(binding = 2, scalar) buffer DispatchesBlock { PortableDispatches dispatches; };
layout(push_constant, scalar) uniform Push {
    uint instance_capacity;
} push;

#include "portable/scan_in_place.glsl"

void main() {
    scan_in_place(0, div_up(totals.visible_kept, SCAN_CHUNK));
    if (lane() == 0) {
        // With 2^32 instances or more the 32-bit sums have wrapped: nothing is drawn, and the demand tells the host.
        uint kept = totals.listed_high > 0 ? 0 : min(totals.listed_low, push.instance_capacity);
        totals.listed_kept = kept;
        dispatches.duplicate = folded(div_up(kept, DUPLICATE_CHUNK));
        dispatches.sort_instances = folded(div_up(kept, SORT_CHUNK));
        dispatches.over_instances = folded(div_up(kept, WORKGROUP));
    }
}
