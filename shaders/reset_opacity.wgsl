// Resets opacities as 3DGS does: they fall to a ceiling, and their Adam moments to zero.
#import shared/thread

struct Reset {
    // Largest logit that stays.
    ceiling: f32,
    // Distance from the focus beyond which all stay.
    frozen_beyond: f32,
    n_gaussians: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> reset: Reset;
@group(0) @binding(2) var<storage, read_write> geometry: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> first_moment: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> second_moment: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn reset_opacity(thread: Thread) {
    let id = thread_index(thread);
    if (id >= reset.n_gaussians || length(geometry[id].xyz) > reset.frozen_beyond) {
        return;
    }
    geometry[id].w = min(geometry[id].w, reset.ceiling);
    first_moment[id].w = 0.0;
    second_moment[id].w = 0.0;
}
