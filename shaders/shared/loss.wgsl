// One image loss. 32 bytes.
struct Loss {
    // (1 - w) weight / (3 total) and w weight / (3 total), total the sum of the pixels' weights.
    l1_scale: f32,
    ssim_scale: f32,
    masked: u32,
    // 1 / (3 total), for the reported means.
    mean_scale: f32,
    // Entry of this loss in `losses`.
    slot: u32,
    n_partials: u32,
    // weight / (3 n) of the loss of the n far pixels, weight / n of the silhouette's, n all pixels; 0: none.
    far_scale: f32,
    silhouette_scale: f32,
}
