// Finds the tiles that each splat reaches, for the rasterizers of one workgroup a tile. The pairs that a workgroup emits are
// one block of the sort by tile: it counts the digits of that sort's first pass as it writes them.
#import shared/bin
#import shared/radix
#import shared/radix_group

const LIST_W = GROUP_TILE;
const LIST_H = GROUP_TILE;

// As radix_count leaves them.
@group(0) @binding(9) var<storage, read_write> digit_counts: array<u32>;

// Atomic additions count alone, and their order does not matter.
var<workgroup> digits: array<atomic<u32>, DIGITS>;

fn emitted(tile: u32) {
    atomicAdd(&digits[tile & (DIGITS - 1u)], 1u);
}

fn emitted_all(thread: Thread) {
    let number = workgroup_index(thread);
    let n_blocks = n_chunks(totals[TOTAL_PAIRS]);
    workgroupBarrier();
    // bound: DIGITS / WORKGROUP turns.
    for (var digit = thread.local; digit < DIGITS; digit += WORKGROUP) {
        if (number < n_blocks) {
            digit_counts[digit * n_blocks + number] = atomicLoad(&digits[digit]);
        }
    }
}
