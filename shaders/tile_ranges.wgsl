// Finds where each tile's pairs begin and end in the sorted pairs, and the Gaussian of each: one thread
// RANGE_CHUNK pairs. Tiles without pairs keep what an earlier view has left until order_tiles empties their ranges.
#import shared/thread
#import shared/view
#import shared/entries

@group(0) @binding(0) var<storage, read_write> totals: array<atomic<u32>>;
// Sorted by tile, front to back within one.
@group(0) @binding(1) var<storage, read> tile_pairs: array<TilePair>;
@group(0) @binding(2) var<storage, read_write> tile_ranges: array<Range>;
@group(0) @binding(3) var<uniform> view: View;
// Per thread of the rasterizers its tile, one past the last where it has none, and the tile's list.
@group(0) @binding(4) var<storage, read_write> tile_order: array<vec4u>;
@group(0) @binding(5) var<storage, read> pair_gaussian: array<u32>;
// In the order of `tile_pairs`.
@group(0) @binding(6) var<storage, read_write> tile_splats: array<vec2u>;

const NO_TILE = 0xffffffffu;

@compute @workgroup_size(WORKGROUP)
fn find_tile_ranges(thread: Thread) {
    let first = (thread_index(thread)) * RANGE_CHUNK;
    let n = atomicLoad(&totals[TOTAL_PAIRS]);
    if (first >= n || atomicLoad(&totals[TOTAL_OVERFLOW]) != 0u) {
        return;
    }
    let last = min(first + RANGE_CHUNK, n);
    var before = NO_TILE;
    if (first > 0u) {
        before = tile_pairs[first - 1u].tile;
    }
    // bound: RANGE_CHUNK turns.
    for (var i = first; i < last; i++) {
        let entry = tile_pairs[i];
        let tile = entry.tile;
        tile_splats[i] = stored_tile_splat(TileSplat(pair_gaussian[entry.pair], entry.pair));
        if (tile != before) {
            tile_ranges[tile].first = i;
            if (before != NO_TILE) {
                tile_ranges[before].end = i;
            }
        }
        before = tile;
    }
    if (last == n) {
        tile_ranges[before].end = n;
    }
}

var<workgroup> lengths: array<u32, WORKGROUP>;

// Orders the tiles of each block by the length of their lists, longest first, tiles outside the
// image last: one workgroup a block. Threads that run in lockstep then have lists of about one
// length, and few wait for another; blocks keep together what lies together in the image.
//
// A list longer than the step's slices cover stops the step, as pairs that do not fit do. It is no
// thread's, nor is any tile once the step has stopped.
@compute @workgroup_size(WORKGROUP)
fn order_tiles(thread: Thread) {
    let block = workgroup_index(thread);
    let n_across = (view.tiles.x + BLOCK_W - 1u) / BLOCK_W;
    let n_down = (view.tiles.y + BLOCK_H - 1u) / BLOCK_H;
    let x = (block % n_across) * BLOCK_W + thread.local % BLOCK_W;
    let y = (block / n_across) * BLOCK_H + thread.local / BLOCK_W;
    let inside = x < view.tiles.x && y < view.tiles.y;
    let tile = select(view.tiles.x * view.tiles.y, y * view.tiles.x + x, inside);
    // One more than the length, 0 outside.
    var length = 0u;
    var range = Range(0u, 0u);
    if (inside) {
        range = tile_ranges[tile];
        // A range that begins with another tile's pair is left from an earlier view.
        let n_pairs = atomicLoad(&totals[TOTAL_PAIRS]);
        if (range.first >= n_pairs || tile_pairs[min(range.first, max(n_pairs, 1u) - 1u)].tile != tile) {
            range = Range(0u, 0u);
            tile_ranges[tile] = range;
        }
        // What ends before it begins, as a driver's fault may have it, is empty.
        range.end = max(range.first, range.end);
        length = 1u + range.end - range.first;
    }
    lengths[thread.local] = length;
    workgroupBarrier();
    var rank = 0u;
    // bound: WORKGROUP turns.
    for (var i = 0u; i < WORKGROUP; i++) {
        let other = lengths[i];
        rank += select(0u, 1u, other > length || (other == length && i < thread.local));
    }
    let too_long = length > view.longest_list + 1u;
    if (block < n_across * n_down) {
        let stopped = too_long || atomicLoad(&totals[TOTAL_OVERFLOW]) != 0u;
        let own = select(tile, view.tiles.x * view.tiles.y, stopped);
        tile_order[block * WORKGROUP + rank] = stored_tile_list(TileList(own, range));
    }
    // The longest of the block; after an overflow all lists are empty.
    if (rank == 0u && too_long) {
        atomicMax(&totals[TOTAL_LONGEST], length - 1u);
        // All that are too long are of one step.
        atomicStore(&totals[TOTAL_OVERFLOW], atomicLoad(&totals[TOTAL_STEP]));
    }
}
