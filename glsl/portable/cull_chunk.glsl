// Marks the Gaussians of a chunk that may touch the image.
// Requires: the bindings of portable/cull.comp, push.gaussians, may_be_visible(bound)

const uint WORDS = CULL_CHUNK / 32;
shared uint words[WORDS];
shared uint count;

void main() {
    uint chunk = workgroup();
    if (chunk * CULL_CHUNK >= push.gaussians) return;
    if (lane() < WORDS) words[lane()] = 0;
    if (lane() == 0) count = 0;
    barrier();
    for (uint i = lane(); i < CULL_CHUNK; i += WORKGROUP) {
        uint gaussian = chunk * CULL_CHUNK + i;
        bool visible = gaussian < push.gaussians && may_be_visible(bounds[gaussian]);
        uvec4 ballot = subgroupBallot(visible);
        if (subgroupElect()) {
            // `first` is a multiple of the subgroup size. The bits are disjoint: order does not matter.
            uint first = i - gl_SubgroupInvocationID;
            for (uint w = 0; w * 32 < gl_SubgroupSize; w++) {
                atomicOr(words[first / 32 + w], ballot[w] << (first % 32));
            }
        }
    }
    barrier();
    if (lane() < WORDS) {
        visible_masks[chunk * WORDS + lane()] = words[lane()];
        atomicAdd(count, bitCount(words[lane()]));  // a sum of integers: order does not matter
    }
    barrier();
    if (lane() == 0) chunk_counts[chunk] = count;
}
