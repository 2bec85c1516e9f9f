// Finds the tiles that each splat reaches, for the rasterizers of one thread a tile. On a CPU, threads in lockstep wait for
// one another at every splat's rows. So a thread has one splat, and most splats reach few tiles; of those that
// reach more than EMIT_CHUNK, further threads write the rest.
#import shared/bin

const LIST_W = TILE_W;
const LIST_H = TILE_H;

// What is written besides COUNT: a splat's first EMIT_CHUNK pairs by a thread each, then what lies beyond by a
// thread for EMIT_CHUNK pairs of the list.
const FIRST = 1u;
const REST = 2u;

// The sort by tile counts its digits itself.
fn emitted(tile: u32) {}

@compute @workgroup_size(WORKGROUP)
fn bin(thread: Thread) {
    let index = thread_index(thread);
    let n = view.n_gaussians;
    let counts = mode.emits == COUNT;
    let rest = mode.emits == REST;
    let chunk = index * EMIT_CHUNK;
    if (!counts && totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    if (select(index >= n, chunk >= totals[TOTAL_PAIRS], rest)) {
        return;
    }
    // Only the rest is searched for its splat, from the largest step that there is.
    let n_searched = select(0u, n, rest);
    let rank = owner(chunk, select(index, 0u, rest), 1u << firstLeadingBit(max(n_searched, 1u)), n_searched);
    let id = depth_order[rank].gaussian;
    var first = 0u;
    var last = 0u;
    if (!counts) {
        first = splat_pairs[rank];
        last = end_of(rank);
    }
    if (mode.emits == FIRST) {
        gaussian_pairs[id] = stored_range(Range(first, last));
    }
    let begin = select(first, max(chunk, first + EMIT_CHUNK), rest);
    let end = min(last, select(first, chunk, rest) + EMIT_CHUNK);
    // A list's chunk may have no splat's rest.
    if (counts || begin < end) {
        let before = walk(id, first, begin, end, counts);
        if (counts) {
            splat_pairs[index] = before;
        }
    }
}
