//! This module finds the far pixels of a view by the cloud's depth in them.

/// Share of a view's pixels that are far (D2GS, Song et al. 2026).
pub const FAR_SHARE: f64 = 0.05;

/// Returns which of the pixels that `counts` says yes to are the farthest [`FAR_SHARE`], rounded up; of equal depths
/// the first. Pixels in which no point lies, of infinite depth, are none of them: nothing tells how far they are.
pub fn far_pixels(depths: &[f32], counts: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut known: Vec<usize> = (0..depths.len())
        .filter(|&i| depths[i].is_finite() && counts(i))
        .collect();
    known.sort_unstable_by(|&a, &b| depths[b].total_cmp(&depths[a]).then(a.cmp(&b)));
    known.truncate((FAR_SHARE * known.len() as f64).ceil() as usize);
    let mut far = vec![false; depths.len()];
    for i in known {
        far[i] = true;
    }
    far
}
