// Finds where each tile's pairs begin and end in the sorted pairs: one thread a pair. Tiles
// without pairs keep the empty range that the buffer was cleared to.
@group(0) @binding(0) var<storage, read> totals: array<u32>;
// (tile, pair), sorted by tile, front to back within one.
@group(0) @binding(1) var<storage, read> tile_pairs: array<vec2u>;
@group(0) @binding(2) var<storage, read_write> tile_ranges: array<vec2u>;

@compute @workgroup_size(WORKGROUP)
fn find_tile_ranges(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = (group.y * groups.x + group.x) * WORKGROUP + local;
    let n = totals[TOTAL_PAIRS];
    if (i >= n || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let tile = tile_pairs[i].x;
    if (i == 0u || tile_pairs[max(i, 1u) - 1u].x != tile) {
        tile_ranges[tile].x = i;
    }
    if (i + 1u == n || tile_pairs[min(i + 1u, n - 1u)].x != tile) {
        tile_ranges[tile].y = i + 1u;
    }
}
