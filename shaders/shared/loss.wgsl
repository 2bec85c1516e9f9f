// One image loss. 32 bytes.
struct Loss {
    // (1 - w) weight / (3 n_valid) and w weight / (3 n_valid).
    l1_scale: f32,
    ssim_scale: f32,
    masked: u32,
    // 1 / (3 n_valid), for the reported means.
    mean_scale: f32,
    // Entry of this loss in `losses`.
    slot: u32,
    n_partials: u32,
    pad_0: u32,
    pad_1: u32,
}
