// Makes one pass of a stable radix sort by a digit of RADIX_DIGITS values: count digits by chunk, scan
// the counts (digit-major), move. One thread a chunk of RADIX_CHUNK entries, which it takes in order: equal
// keys keep theirs, so the result is the same on every adapter.
#import shared/thread
#import shared/radix
#import shared/radix_thread

@group(0) @binding(0) var<uniform> radix: Radix;
// Two entries a vector, key and value of each: a software driver loads one as fast as half of it.
@group(0) @binding(1) var<storage, read> entries_in: array<vec4u>;
@group(0) @binding(2) var<storage, read_write> entries_out: array<vec2u>;
// Entry digit * n_chunks + chunk.
@group(0) @binding(3) var<storage, read_write> digit_counts: array<u32>;
@group(0) @binding(4) var<storage, read> totals: array<u32>;

// One counter of 8 bits a digit, which is enough: a chunk has fewer than 256 entries.
fn one(digit: u32) -> vec4u {
    return select(vec4u(0u), vec4u(1u << (8u * (digit & 3u))), vec4u(digit >> 2u) == vec4u(0u, 1u, 2u, 3u));
}

fn counter(counters: vec4u, digit: u32) -> u32 {
    let word = select(
        select(counters.x, counters.y, (digit >> 2u) == 1u),
        select(counters.z, counters.w, (digit >> 2u) == 3u),
        digit >= 8u,
    );
    return (word >> (8u * (digit & 3u))) & 255u;
}

@compute @workgroup_size(WORKGROUP)
fn radix_count(thread: Thread) {
    let chunk = thread_index(thread);
    let n = n_entries(radix, totals[TOTAL_PAIRS], totals[TOTAL_OVERFLOW]);
    let n_chunks = n_chunks(n);
    if (chunk >= n_chunks) {
        return;
    }
    let first = chunk * RADIX_CHUNK;
    let end = min(first + RADIX_CHUNK, n);
    var counters = vec4u(0u);
    // bound: RADIX_CHUNK / 2 turns.
    for (var i = first; i < end; i += 2u) {
        let digits = (entries_in[i / 2u].xz >> vec2u(radix.shift)) & vec2u(RADIX_DIGITS - 1u);
        counters += one(digits.x);
        counters += select(vec4u(0u), one(digits.y), i + 1u < end);
    }
    // bound: RADIX_DIGITS turns.
    for (var digit = 0u; digit < RADIX_DIGITS; digit++) {
        digit_counts[digit * n_chunks + chunk] = counter(counters, digit);
    }
}

@compute @workgroup_size(WORKGROUP)
fn radix_move(thread: Thread) {
    let chunk = thread_index(thread);
    let n = n_entries(radix, totals[TOTAL_PAIRS], totals[TOTAL_OVERFLOW]);
    let n_chunks = n_chunks(n);
    if (chunk >= n_chunks) {
        return;
    }
    let first = chunk * RADIX_CHUNK;
    let end = min(first + RADIX_CHUNK, n);
    var counters = vec4u(0u);
    // bound: RADIX_CHUNK / 2 turns.
    for (var i = first; i < end; i += 2u) {
        let entries = entries_in[i / 2u];
        let digits = (entries.xz >> vec2u(radix.shift)) & vec2u(RADIX_DIGITS - 1u);
        entries_out[digit_counts[digits.x * n_chunks + chunk] + counter(counters, digits.x)] = entries.xy;
        counters += one(digits.x);
        if (i + 1u < end) {
            entries_out[digit_counts[digits.y * n_chunks + chunk] + counter(counters, digits.y)] = entries.zw;
            counters += one(digits.y);
        }
    }
}
