// Makes the splats of a chunk of Gaussians.
// Requires: fast/make_splat.glsl, and its bindings and push constants

void main() {
    uint begin = workgroup() * PROJECT_CHUNK;
    if (begin >= push.gaussians) return;
    if (lane() == 0) found = splats_here = spans_here = 0;
    barrier();
    for (uint i = lane(); i < PROJECT_CHUNK; i += WORKGROUP) {
        uint gaussian = begin + i;
        float z = 0.0;
        bool visible = gaussian < push.gaussians && may_be_visible(bounds[gaussian], z);
        uvec4 ballot = subgroupBallot(visible);
        uint place = 0;
        if (subgroupElect()) place = atomicAdd(found, subgroupBallotBitCount(ballot));
        place = subgroupBroadcastFirst(place) + subgroupBallotExclusiveBitCount(ballot);
        if (visible) {
            survivors[place] = gaussian;
            depths[place] = z;
        }
    }
    barrier();
    for (uint i = 0; i < found; i += WORKGROUP) {
        bool exists = i + lane() < found;
        make_splat(exists ? survivors[i + lane()] : 0, exists ? depths[i + lane()] : push.view.near, exists);
    }
}
