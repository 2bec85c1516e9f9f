// One pass of a radix sort. 16 bytes. The stage that imports this says how many entries a chunk has, and how many values a
// digit (`CHUNK`, `DIGITS`).
struct Radix {
    // Entries, or room for them where `pairs` is 1: then there are as many as the view has pairs.
    n: u32,
    pairs: u32,
    // Bits below the pass's digit.
    shift: u32,
    // Not 0: what moves is counted for the next pass.
    counts_next: u32,
}

fn n_entries(radix: Radix, n_pairs: u32, overflow: u32) -> u32 {
    if (radix.pairs == 0u) {
        return radix.n;
    }
    return select(n_pairs, 0u, overflow != 0u);
}

fn n_chunks(n: u32) -> u32 {
    return (n + CHUNK - 1u) / CHUNK;
}
