// Makes one pass of a stable radix sort by a digit of GROUP_RADIX_DIGITS values: count digits by block, scan the
// counts (digit-major), move. One workgroup a block of entries. It sorts them by the digit in its own memory, by the
// lower four bits and then by the upper, so that those of one digit leave side by side; equal keys keep their order, so the
// result is the same on every adapter. Atomic additions count alone, and their order does not matter.
#import shared/thread
#import shared/radix
#import shared/radix_group

@group(0) @binding(0) var<uniform> radix: Radix;
// Key and value.
@group(0) @binding(1) var<storage, read> entries_in: array<vec2u>;
@group(0) @binding(2) var<storage, read_write> entries_out: array<vec2u>;
// Entry digit * n_chunks + block.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;
@group(0) @binding(4) var<storage, read> totals: array<u32>;

// Entries of a block that a thread ranks, which lie in a row; as many values have half a digit's bits.
const OWN = CHUNK / WORKGROUP;
// Room for CHUNK numbers of which threads read OWN in a row each: no two of them from one bank.
const PADDED = CHUNK + CHUNK / OWN;

var<workgroup> digits: array<atomic<u32>, DIGITS>;
// The block's entries: digit, and place in the block.
var<workgroup> block: array<u32, PADDED>;
// By half a digit, then by thread.
var<workgroup> counts: array<u32, PADDED>;
var<workgroup> sums: array<u32, WORKGROUP>;
// First place of each digit in the sorted block.
var<workgroup> firsts: array<u32, DIGITS>;

fn padded(i: u32) -> u32 {
    return i + i / OWN;
}

fn digit_of(key: u32) -> u32 {
    return (key >> radix.shift) & (DIGITS - 1u);
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

// Sum of `mine` over the threads before this one.
fn sum_before(local: u32, mine: u32) -> u32 {
    var sum = mine;
    // bound: 6 turns, `step` doubles up to WORKGROUP.
    for (var step = 1u; step < WORKGROUP; step *= 2u) {
        sums[local] = sum;
        workgroupBarrier();
        sum += select(0u, sums[max(local, step) - step], local >= step);
        workgroupBarrier();
    }
    return sum - mine;
}

// Sorts the block by four bits from `shift` on.
fn sort_half(local: u32, shift: u32) {
    #repeat j 16
    let e_{j} = block[padded(local * OWN + {j}u)];
    let place_{j} = padded(((e_{j} >> shift) & (OWN - 1u)) * WORKGROUP + local);
    counts[padded({j}u * WORKGROUP + local)] = 0u;
    #end
    #repeat j 16
    counts[place_{j}] += 1u;
    #end
    workgroupBarrier();
    // Counts become numbers of entries before, half a digit by half a digit, thread by thread.
    var sum = 0u;
    #repeat j 16
    let count_{j} = counts[padded(local * OWN + {j}u)];
    sum += count_{j};
    #end
    var before = sum_before(local, sum);
    #repeat j 16
    counts[padded(local * OWN + {j}u)] = before;
    before += count_{j};
    #end
    workgroupBarrier();
    #repeat j 16
    let to_{j} = counts[place_{j}];
    counts[place_{j}] = to_{j} + 1u;
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
    workgroupBarrier();
    // bound: OWN turns.
    for (var j = 0u; j < OWN; j++) {
        let at = j * WORKGROUP + thread.local;
        let entry = block[padded(at)];
        let digit = entry >> 16u;
        let source = first + (entry & 0xffffu);
        if (source < n) {
            entries_out[digit_counts[digit * n_blocks + number] + at - firsts[digit]] = entries_in[source];
        }
    }
}
