// The number of pairs whose sum stands at `pair`, of a Gaussian whose pairs end before `end`: single ones up
// to an aligned block, such blocks up to an aligned block of them, those, and the same backwards.
fn n_summed(pair: u32, end: u32) -> u32 {
    let left = end - pair;
    let n = select(1u, PAIR_BLOCK, pair % PAIR_BLOCK == 0u && left >= PAIR_BLOCK);
    let large = PAIR_BLOCK * PAIR_BLOCK;
    return select(n, large, pair % large == 0u && left >= large);
}
