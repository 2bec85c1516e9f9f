// Dropout (Park et al. 2025, "DropGaussian"): each Gaussian is left out with probability p, and the
// opacity of the others is divided by 1 - p. Which ones is a hash of their index and of a key of
// the iteration, so that forward and backward agree and a step can be repeated.
//
// Guided by depth and density (Song et al. 2026, "D2GS"), a Gaussian has a share of p of its own, and
// the others keep their opacity.

// PCG hash (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
fn pcg(v: u32) -> u32 {
    let state = v * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// `density`: the Gaussian's score.
fn is_dropped(view: View, id: u32, mean: vec3f, density: f32) -> bool {
    let d = distance(mean, view.center);
    let layer = select(select(0.3, 0.7, d <= view.middle_layer), 1.0, d <= view.near_layer);
    let share = layer * (view.share_base + view.share_per_distance * d + view.share_per_density * density);
    // Exact without a guide.
    let threshold = select(u32(f32(view.drop_threshold) * saturate(share)), view.drop_threshold, view.compensates == 1.0);
    return pcg(pcg(id) ^ view.drop_key) < threshold;
}

// 1 - p; exactly 1 without dropout.
fn kept_share(view: View) -> f32 {
    return 1.0 - view.compensates * f32(view.drop_threshold) / 4294967296.0;
}
