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
    pad_0: u32,
    pad_1: u32,
}
