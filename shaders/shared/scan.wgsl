// Turns counts into their exclusive prefix sums in place, in two dispatches: the first sums blocks, and
// in the second each block adds up the sums before it. Few counts take one dispatch. Additions saturate, so that a total
// beyond 2^32 is seen as too large instead of wrapping.
// The stage that imports this says how a workgroup adds its sums up (`scan_workgroup`).
#import shared/thread
#import shared/radix

struct Scan {
    // Number of counts (0: the digit counts of the view's pairs); index in `totals` of their sum;
    // capacity that the sum is held against (0: none); the step's number, stored on overflow.
    n: u32,
    total: u32,
    capacity: u32,
    step: u32,
}

const BLOCK = SCAN_CHUNK * WORKGROUP;

@group(0) @binding(0) var<uniform> scan: Scan;
// Four counts a vector; what follows the last count in its vector is overwritten.
@group(0) @binding(1) var<storage, read_write> counts: array<vec4u>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<u32>;
@group(0) @binding(3) var<storage, read_write> totals: array<u32>;

var<workgroup> sums: array<u32, WORKGROUP>;

fn n_counts() -> u32 {
    if (scan.n != 0u) {
        return scan.n;
    }
    let pairs = Radix(0u, 1u, 0u, 0u);
    return n_chunks(n_entries(pairs, totals[TOTAL_PAIRS], totals[TOTAL_OVERFLOW])) * DIGITS;
}

fn saturating_add(a: u32, b: u32) -> u32 {
    let s = a + b;
    return select(s, 0xffffffffu, s < a);
}

// Counts i to i + 3, 0 beyond the last.
fn four_counts(i: u32, n: u32) -> vec4u {
    return select(vec4u(0u), counts[i / 4u], vec4u(i) + vec4u(0u, 1u, 2u, 3u) < vec4u(n));
}

fn chunk_sum(first: u32) -> u32 {
    let n = n_counts();
    var sum = 0u;
    // bound: SCAN_CHUNK / 4 turns.
    for (var i = first; i < min(first + SCAN_CHUNK, n); i += 4u) {
        let c = four_counts(i, n);
        sum = saturating_add(sum, saturating_add(saturating_add(c.x, c.y), saturating_add(c.z, c.w)));
    }
    return sum;
}

// Turns a chunk into its exclusive sums; `before` is the sum of all before it.
fn spread(first: u32, before: u32) {
    let n = n_counts();
    var sum = before;
    // bound: SCAN_CHUNK / 4 turns.
    for (var i = first; i < min(first + SCAN_CHUNK, n); i += 4u) {
        let c = four_counts(i, n);
        let y = saturating_add(sum, c.x);
        let z = saturating_add(y, c.y);
        let w = saturating_add(z, c.z);
        counts[i / 4u] = vec4u(sum, y, z, w);
        sum = saturating_add(w, c.w);
    }
}

fn keep_total(total: u32) {
    totals[scan.total] = total;
    if (scan.capacity != 0u) {
        totals[TOTAL_STEP] = scan.step;
        totals[TOTAL_MAX] = max(totals[TOTAL_MAX], total);
    }
    if (scan.capacity != 0u && total > scan.capacity && totals[TOTAL_OVERFLOW] == 0u) {
        // Sticky: every later stage of this and of the following steps does nothing until the
        // host has made room and cleared it.
        totals[TOTAL_OVERFLOW] = scan.step;
    }
}

@compute @workgroup_size(WORKGROUP)
fn scan_reduce(thread: Thread) {
    let block = workgroup_index(thread);
    sums[thread.local] = chunk_sum(block * BLOCK + thread.local * SCAN_CHUNK);
    let total = scan_workgroup(thread.local);
    if (thread.local == 0u && block * BLOCK < n_counts()) {
        block_sums[block] = total;
    }
}

@compute @workgroup_size(WORKGROUP)
fn scan_spread(thread: Thread) {
    let block = workgroup_index(thread);
    let n_blocks = (n_counts() + BLOCK - 1u) / BLOCK;
    var sum = 0u;
    // bound: n / (SCAN_CHUNK WORKGROUP^2) + 1 turns: 2^15 for 2^32 counts.
    for (var i = thread.local; i < min(block, n_blocks); i += WORKGROUP) {
        sum = saturating_add(sum, block_sums[i]);
    }
    sums[thread.local] = sum;
    let before = scan_workgroup(thread.local);
    let first = block * BLOCK + thread.local * SCAN_CHUNK;
    sums[thread.local] = chunk_sum(first);
    let total = scan_workgroup(thread.local);
    spread(first, saturating_add(before, sums[thread.local]));
    if (thread.local == 0u && block + 1u == max(n_blocks, 1u)) {
        keep_total(saturating_add(before, total));
    }
}

// All of it in one dispatch, for at most SCAN_FEW blocks.
@compute @workgroup_size(WORKGROUP)
fn scan_few(thread: Thread) {
    var before = 0u;
    // bound: SCAN_FEW turns.
    for (var block = 0u; block < SCAN_FEW; block++) {
        let first = block * BLOCK + thread.local * SCAN_CHUNK;
        sums[thread.local] = chunk_sum(first);
        let total = scan_workgroup(thread.local);
        spread(first, saturating_add(before, sums[thread.local]));
        before = saturating_add(before, total);
    }
    if (thread.local == 0u) {
        keep_total(before);
    }
}
