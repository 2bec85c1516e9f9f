// One step of Adam (Kingma and Ba 2015; bias-corrected, epsilon added to the root, as PyTorch):
// one thread a Gaussian. SH gradients are never stored: coefficient k gets basis_k(direction)
// times the view's colour gradient, summed over the step's views here.
#import shared/sh

struct Step {
    // Optical centres of the step's views; w: 1 where the view takes part.
    centers: array<vec4f, 2>,
    // Learning rates: planes 0 to 2 of the geometry, then x: SH degree 0, y: higher degrees.
    rates: array<vec4f, 4>,
    // beta1, beta2, 1 - beta1, 1 - beta2: the difference would lose three digits here.
    betas: vec4f,
    // 1 / (1 - beta1^t), 1 / sqrt(1 - beta2^t), epsilon, 0.
    corrections: vec4f,
    // Number of Gaussians, stride, active SH degree, 0.
    counts: vec4u,
}

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> parameters: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> first_moment: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> second_moment: array<vec4f>;
// Geometry: gradient planes. SH: geometry planes, for the mean.
@group(0) @binding(4) var<storage, read> source: array<vec4f>;
@group(0) @binding(5) var<storage, read> d_color: array<vec4f>;
// SH: x: first plane of this block, y: number of planes.
@group(0) @binding(6) var<uniform> block: vec4u;
@group(0) @binding(7) var<storage, read> totals: array<u32>;
@group(0) @binding(8) var<storage, read> screen: array<vec2f>;
// Densification statistics: sum of |d_mean2d|, number of views drawn in, largest radius, 0.
// They belong to the step that is taken, not to the view: a step that is repeated because its
// pairs did not fit counts once.
@group(0) @binding(9) var<storage, read_write> statistics: array<vec4f>;

fn update(index: u32, gradient: vec4f, rate: vec4f) {
    let m = step.betas.x * first_moment[index] + step.betas.z * gradient;
    let v = step.betas.y * second_moment[index] + step.betas.w * (gradient * gradient);
    first_moment[index] = m;
    second_moment[index] = v;
    parameters[index] -= rate * (m * step.corrections.x) / (sqrt(v) * step.corrections.y + step.corrections.z);
}

@compute @workgroup_size(WORKGROUP)
fn adam_geometry(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let id = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (id >= step.counts.x || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    for (var plane = 0u; plane < 3u; plane++) {
        let index = plane * step.counts.y + id;
        update(index, source[index], step.rates[plane]);
    }
    let seen = screen[id];
    if (seen.y > 0.0) {
        let old = statistics[id];
        statistics[id] = vec4f(old.x + seen.x, old.y + 1.0, max(old.z, seen.y), 0.0);
    }
}

// Gradient of the four packed floats of plane `plane`.
fn sh_gradient(plane: u32, basis: ptr<function, array<f32, 16>>, color: vec3f) -> vec4f {
    let first = 4u * plane;
    let k = first / 3u;
    switch (first % 3u) {
        case 0u: { return vec4f((*basis)[k] * color, (*basis)[k + 1u] * color.x); }
        case 1u: { return vec4f((*basis)[k] * color.yz, (*basis)[k + 1u] * color.xy); }
        default: { return vec4f((*basis)[k] * color.z, (*basis)[k + 1u] * color); }
    }
}

@compute @workgroup_size(WORKGROUP)
fn adam_sh(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let id = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (id >= step.counts.x || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let stride = step.counts.y;
    let mean = source[id].xyz;
    // A Gaussian at an optical centre is never drawn: its direction only must not be NaN.
    let offset_0 = mean - step.centers[0].xyz;
    let offset_1 = mean - step.centers[1].xyz;
    var basis_0 = sh_basis(offset_0 / max(length(offset_0), 1e-30), step.counts.z);
    var basis_1 = sh_basis(offset_1 / max(length(offset_1), 1e-30), step.counts.z);
    let color_0 = d_color[id].xyz * step.centers[0].w;
    let color_1 = d_color[stride + id].xyz * step.centers[1].w;
    for (var p = 0u; p < block.y; p++) {
        let plane = block.x + p;
        let gradient = sh_gradient(plane, &basis_0, color_0) + sh_gradient(plane, &basis_1, color_1);
        var rate = vec4f(step.rates[3].y);
        if (plane == 0u) {
            rate = vec4f(vec3f(step.rates[3].x), step.rates[3].y);
        }
        update(p * stride + id, gradient, rate);
    }
}
