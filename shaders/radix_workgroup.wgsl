// Makes one pass of a stable radix sort by a digit of GROUP_RADIX_DIGITS values: count digits by block, unless what has
// made or moved the entries has counted them, scan the counts digit by digit, move. One workgroup a block of entries, or a
// digit of the scan. It sorts them by the digit in its own memory, by the lower four bits and then by the upper, so that those
// of one digit leave side by side; equal keys keep their order, so the result is the same on every adapter. Atomic additions
// count alone, and their order does not matter.
#import shared/thread
#import shared/radix
#import shared/radix_group

@group(0) @binding(0) var<uniform> radix: Radix;
// Key and value.
@group(0) @binding(1) var<storage, read> entries_in: array<vec2u>;
@group(0) @binding(2) var<storage, read_write> entries_out: array<vec2u>;
// Entry digit * n_chunks + block, and behind them what all blocks have of each digit.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;
@group(0) @binding(4) var<storage, read> totals: array<u32>;
// The counts of the next pass where this one makes them: the scan clears them, and each entry that moves is counted in the
// block that it moves to.
@group(0) @binding(5) var<storage, read_write> next_counts: array<atomic<u32>>;

// Entries of a block that a thread ranks, which lie in a row; as many values have half a digit's bits.
const OWN = CHUNK / WORKGROUP;
// Room for CHUNK numbers of which threads read OWN in a row each: no two of them from one bank.
const PADDED = CHUNK + CHUNK / OWN;
// Counts of 16 bits lie in pairs: that of half a digit, and that of the one HALF further on. A thread reads HALF pairs in a row.
const HALF = OWN / 2u;
const PADDED_COUNTS = HALF * WORKGROUP + WORKGROUP;
// Digits whose counts a thread adds up.
const OWN_DIGITS = DIGITS / WORKGROUP;

var<workgroup> digits: array<atomic<u32>, DIGITS>;
// The block's entries: digit, and place in the block.
var<workgroup> block: array<u32, PADDED>;
// By half a digit, then by thread.
var<workgroup> counts: array<u32, PADDED_COUNTS>;
var<workgroup> sums: array<u32, WORKGROUP>;
// First place of each digit in the sorted block; then what takes a place in the block to one in the sorted list.
var<workgroup> firsts: array<u32, DIGITS>;
// The sum of all threads' numbers.
var<workgroup> sum_of_all: u32;

fn padded(i: u32) -> u32 {
    return i + i / OWN;
}

fn padded_counts(i: u32) -> u32 {
    return i + i / HALF;
}

fn digit_of(key: u32) -> u32 {
    return (key >> radix.shift) & (DIGITS - 1u);
}

fn next_digit_of(key: u32) -> u32 {
    return (key >> (radix.shift + DIGIT_BITS)) & (DIGITS - 1u);
}

@compute @workgroup_size(WORKGROUP)
fn radix_count(thread: Thread) {
    let number = workgroup_index(thread);
    let n = n_entries(radix, totals[TOTAL_PAIRS], totals[TOTAL_OVERFLOW]);
    let n_blocks = n_chunks(n);
    // bound: OWN turns.
    for (var j = 0u; j < OWN; j++) {
        let i = number * CHUNK + j * WORKGROUP + thread.local;
        if (i < n) {
            atomicAdd(&digits[digit_of(entries_in[i].x)], 1u);
        }
    }
    workgroupBarrier();
    // bound: DIGITS / WORKGROUP turns.
    for (var digit = thread.local; digit < DIGITS; digit += WORKGROUP) {
        if (number < n_blocks) {
            digit_counts[digit * n_blocks + number] = atomicLoad(&digits[digit]);
        }
    }
}

// Sum of `mine` over the threads before this one; `sum_of_all` is that of all. Another barrier follows before the next call.
fn sum_before(local: u32, mine: u32) -> u32 {
    var sum = mine;
    // bound: 6 turns, `step` doubles up to WORKGROUP.
    for (var step = 1u; step < WORKGROUP; step *= 2u) {
        sums[local] = sum;
        workgroupBarrier();
        sum += select(0u, sums[max(local, step) - step], local >= step);
        workgroupBarrier();
    }
    if (local == WORKGROUP - 1u) {
        sum_of_all = sum;
    }
    workgroupBarrier();
    return sum - mine;
}

// Turns a digit's counts into the numbers of its entries in the blocks before, and keeps what all blocks have: one
// workgroup a digit.
@compute @workgroup_size(WORKGROUP)
fn radix_scan(thread: Thread) {
    let digit = workgroup_index(thread);
    let n_blocks = n_chunks(n_entries(radix, totals[TOTAL_PAIRS], totals[TOTAL_OVERFLOW]));
    let row = min(digit, DIGITS - 1u) * n_blocks;
    var before = 0u;
    // bound: n_blocks / (OWN_DIGITS WORKGROUP) + 1 turns: 2^12 for 2^30 entries, each with a sum's 6.
    for (var first = 0u; first < n_blocks; first += OWN_DIGITS * WORKGROUP) {
        let at = first + OWN_DIGITS * thread.local;
        var sum = 0u;
        #repeat j 4
        let count_{j} = select(0u, digit_counts[row + min(at + {j}u, n_blocks - 1u)], at + {j}u < n_blocks);
        sum += count_{j};
        #end
        var own = before + sum_before(thread.local, sum);
        before += sum_of_all;
        #repeat j 4
        if (at + {j}u < n_blocks && digit < DIGITS) {
            digit_counts[row + at + {j}u] = own;
            if (radix.counts_next != 0u) {
                atomicStore(&next_counts[row + at + {j}u], 0u);
            }
        }
        own += count_{j};
        #end
        workgroupBarrier();
    }
    if (thread.local == 0u && digit < DIGITS) {
        digit_counts[DIGITS * n_blocks + digit] = before;
    }
}

// Sorts the block by four bits from `shift` on.
fn sort_half(local: u32, shift: u32) {
    #repeat j 16
    let e_{j} = block[padded(local * OWN + {j}u)];
    let place_{j} = padded_counts(((e_{j} >> shift) & (HALF - 1u)) * WORKGROUP + local);
    // A condition takes no vector register.
    let is_upper_{j} = (e_{j} & (HALF << shift)) != 0u;
    #end
    #repeat j 8
    counts[padded_counts({j}u * WORKGROUP + local)] = 0u;
    #end
    #repeat j 16
    counts[place_{j}] += select(1u, 1u << 16u, is_upper_{j});
    #end
    workgroupBarrier();
    // Counts become numbers of entries before, half a digit by half a digit, thread by thread; those of both
    // halves at once, and all that the lower half counts is before the upper. A block has no more than CHUNK.
    var sum = 0u;
    #repeat j 8
    let count_{j} = counts[padded_counts(local * HALF + {j}u)];
    sum += count_{j};
    #end
    var before = sum_before(local, sum);
    before += sum_of_all << 16u;
    #repeat j 8
    counts[padded_counts(local * HALF + {j}u)] = before;
    before += count_{j};
    #end
    workgroupBarrier();
    #repeat j 16
    let both_{j} = counts[place_{j}];
    let to_{j} = select(both_{j} & 0xffffu, both_{j} >> 16u, is_upper_{j});
    counts[place_{j}] = both_{j} + select(1u, 1u << 16u, is_upper_{j});
    block[padded(to_{j})] = e_{j};
    #end
    workgroupBarrier();
}

@compute @workgroup_size(WORKGROUP)
fn radix_move(thread: Thread) {
    let number = workgroup_index(thread);
    let n = n_entries(radix, totals[TOTAL_PAIRS], totals[TOTAL_OVERFLOW]);
    let n_blocks = n_chunks(n);
    let first = number * CHUNK;
    // bound: OWN turns.
    for (var j = 0u; j < OWN; j++) {
        let at = j * WORKGROUP + thread.local;
        // What lies beyond the last entry goes behind all, where it is.
        var digit = DIGITS - 1u;
        if (first + at < n) {
            digit = digit_of(entries_in[first + at].x);
        }
        block[padded(at)] = (digit << 16u) | at;
    }
    workgroupBarrier();
    sort_half(thread.local, 16u);
    sort_half(thread.local, 20u);
    // bound: OWN turns.
    for (var j = 0u; j < OWN; j++) {
        let at = j * WORKGROUP + thread.local;
        let digit = block[padded(at)] >> 16u;
        if (at == 0u || (block[padded(max(at, 1u) - 1u)] >> 16u) != digit) {
            firsts[digit] = at;
        }
    }
    // Entries of smaller digits, and of the same one in the blocks before, come first.
    let own = OWN_DIGITS * thread.local;
    var sum = 0u;
    #repeat j 4
    let count_{j} = digit_counts[DIGITS * n_blocks + own + {j}u];
    sum += count_{j};
    #end
    var before = sum_before(thread.local, sum);
    if (number < n_blocks) {
        #repeat j 4
        firsts[own + {j}u] = before + digit_counts[(own + {j}u) * n_blocks + number] - firsts[own + {j}u];
        before += count_{j};
        #end
    }
    workgroupBarrier();
    // bound: OWN turns.
    for (var j = 0u; j < OWN; j++) {
        let at = j * WORKGROUP + thread.local;
        let entry = block[padded(at)];
        let digit = entry >> 16u;
        let source = first + (entry & 0xffffu);
        if (source < n) {
            let moved = entries_in[source];
            let to = firsts[digit] + at;
            entries_out[to] = moved;
            if (radix.counts_next != 0u) {
                atomicAdd(&next_counts[next_digit_of(moved.x) * n_blocks + to / CHUNK], 1u);
            }
        }
    }
}
