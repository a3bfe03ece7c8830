// The groups of nodes that are hidden behind what a picture shows.
// Requires: pages/page.glsl, lod/selection.glsl, fast/frame.glsl, stop_depths[], push.focal_px, push.centre_px,
// push.size_px, push.occlusion

PlacedView stop_view;  // the camera of the picture that made the stop depths

const uint MOST_CELLS = 64;  // blocks or bins that are looked at for a group; larger groups count as visible

// The interval of a box along an axis.
vec2 extent_along(vec3 axis, vec3 low, vec3 high) {
    precise vec3 one = axis * low, other = axis * high;
    precise vec3 least = min(one, other), most = max(one, other);
    precise vec2 extent = vec2((least.x + least.y) + least.z, (most.x + most.y) + most.z);
    return extent;
}

// True if all these blocks, or bins, stopped in front of a depth.
bool are_in_front(uvec2 first, uvec2 last, bool are_blocks, float depth) {
    uvec2 bin_blocks = uvec2(BIN_COLUMNS, BIN_ROWS), bins = push.occlusion.bins;
    for (uint y = first.y; y <= last.y; y++) {
        for (uint x = first.x; x <= last.x; x++) {
            uvec2 bin = are_blocks ? uvec2(x, y) / bin_blocks : uvec2(x, y), block = uvec2(x, y) % bin_blocks;
            uint place = bin.y * bins.x + bin.x;
            place = are_blocks ? place * BLOCKS + block.y * BIN_COLUMNS + block.x : bins.x * bins.y * BLOCKS + place;
            if (!(stop_depths[place] < depth)) return false;
        }
    }
    return true;
}

// True if the centres of a group lie behind what the picture shows. All operations are monotone, so what is in the box
// of a hidden group is hidden, too. Only the rounding of a quotient may break that, at the border of a block. Then two
// nodes on a path are drawn.
bool is_hidden(PageBox box) {
    precise vec3 low = (box.lod_low - stop_view.position_high) - stop_view.position_low;
    precise vec3 high = (box.lod_high - stop_view.position_high) - stop_view.position_low;
    vec2 z = extent_along(stop_view.forward, low, high);
    if (!(z.x > stop_view.near)) return false;
    vec2 x = extent_along(stop_view.right, low, high), y = extent_along(stop_view.down, low, high);
    vec2 from = vec2(x.x, y.x), to = vec2(x.y, y.y), size = vec2(push.size_px);
    precise vec2 least = push.focal_px * min(from / z.x, from / z.y) + push.centre_px;
    precise vec2 most = push.focal_px * max(to / z.x, to / z.y) + push.centre_px;
    // What was outside the picture of another camera is not known.
    bool is_inside = all(greaterThanEqual(least, vec2(0.0))) && all(lessThanEqual(most, size));
    if (push.occlusion.is_of_this_camera == 0 && !is_inside) return false;
    precise float depth = z.x * stop_view.scale;
    uvec2 first = uvec2(clamp(least, vec2(0.0), size - 1.0)), last = uvec2(clamp(most, vec2(0.0), size - 1.0));
    uvec2 block_px = uvec2(BLOCK_WIDTH, push.occlusion.block_height), bin_px = block_px * uvec2(BIN_COLUMNS, BIN_ROWS);
    uvec2 blocks = last / block_px - first / block_px + 1, bins = last / bin_px - first / bin_px + 1;
    if (blocks.x * blocks.y <= MOST_CELLS) return are_in_front(first / block_px, last / block_px, true, depth);
    return bins.x * bins.y <= MOST_CELLS && are_in_front(first / bin_px, last / bin_px, false, depth);
}
