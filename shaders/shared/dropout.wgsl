// Dropout (Park et al. 2025, "DropGaussian"): each Gaussian is left out with probability p, and the
// opacity of the others is divided by 1 - p. Which ones is a hash of their index and of a key of
// the iteration, so that forward and backward agree and a step can be repeated.

// PCG hash (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
fn pcg(v: u32) -> u32 {
    let state = v * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

fn is_dropped(view: View, id: u32) -> bool {
    return pcg(pcg(id) ^ view.counts.w) < view.counts.z;
}

// 1 - p; exactly 1 without dropout.
fn kept_share(view: View) -> f32 {
    return 1.0 - f32(view.counts.z) / 4294967296.0;
}
