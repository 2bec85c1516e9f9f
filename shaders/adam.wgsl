// One step of Adam (Kingma and Ba 2015; bias-corrected, epsilon added to the root, as PyTorch):
// one thread a Gaussian. SH gradients are never stored: coefficient k gets basis_k(direction)
// times the view's colour gradient, summed over the step's views here.
#import shared/thread
#import shared/sh

struct Step {
    // Optical centres of the step's views; w: 1 where the view takes part. Their low parts hold the
    // digits that f32 has no room for.
    centers: array<vec4f, 2>,
    centers_low: array<vec4f, 2>,
    // Learning rates: planes 0 to 2 of the geometry, then x: SH degree 0, y: higher degrees.
    rates: array<vec4f, 4>,
    // beta1, beta2, 1 - beta1, 1 - beta2: the difference would lose three digits here.
    betas: vec4f,
    // 1 / (1 - beta1^t), 1 / sqrt(1 - beta2^t), epsilon, 0.
    corrections: vec4f,
    // x: distance from the focus beyond which a Gaussian's geometry is frozen.
    limits: vec4f,
    // Number of Gaussians, stride, 0, 0.
    counts: vec4u,
}

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> parameters: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> first_moment: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> second_moment: array<vec4f>;
// Geometry: gradient planes. SH: geometry planes, for the mean.
@group(0) @binding(4) var<storage, read> source: array<vec4f>;
@group(0) @binding(5) var<storage, read> d_color: array<vec4f>;
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
fn adam_geometry(thread: Thread) {
    let id = thread_index(thread);
    if (id >= step.counts.x || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let frozen = length(parameters[id].xyz) > step.limits.x;
    // bound: 3 turns.
    for (var plane = 0u; plane < 3u; plane++) {
        let index = plane * step.counts.y + id;
        update(index, source[index], select(step.rates[plane], vec4f(0.0), frozen));
    }
    let seen = screen[id];
    if (seen.y > 0.0) {
        let old = statistics[id];
        statistics[id] = vec4f(old.x + seen.x, old.y + 1.0, max(old.z, seen.y), 0.0);
    }
}

// What the SH gradient of a step's views needs: basis and colour gradient of each.
struct ShGradient {
    basis_0: Basis,
    basis_1: Basis,
    color_0: vec3f,
    color_1: vec3f,
}

fn sh_gradient(id: u32) -> ShGradient {
    let mean = source[id].xyz;
    // A Gaussian at an optical centre is never drawn: its direction only must not be NaN.
    let offset_0 = (mean - step.centers[0].xyz) - step.centers_low[0].xyz;
    let offset_1 = (mean - step.centers[1].xyz) - step.centers_low[1].xyz;
    return ShGradient(
        sh_basis(offset_0 / max(length(offset_0), 1e-30)),
        sh_basis(offset_1 / max(length(offset_1), 1e-30)),
        d_color[id].xyz * step.centers[0].w,
        d_color[step.counts.y + id].xyz * step.centers[1].w,
    );
}

// Gradients of the three planes of a group of four coefficients, of both views.
fn sh_first(y_0: vec4f, y_1: vec4f, c_0: vec3f, c_1: vec3f) -> vec4f {
    return vec4f(y_0.x * c_0, y_0.y * c_0.x) + vec4f(y_1.x * c_1, y_1.y * c_1.x);
}

fn sh_second(y_0: vec4f, y_1: vec4f, c_0: vec3f, c_1: vec3f) -> vec4f {
    return vec4f(y_0.y * c_0.yz, y_0.z * c_0.xy) + vec4f(y_1.y * c_1.yz, y_1.z * c_1.xy);
}

fn sh_third(y_0: vec4f, y_1: vec4f, c_0: vec3f, c_1: vec3f) -> vec4f {
    return vec4f(y_0.z * c_0.z, y_0.w * c_0) + vec4f(y_1.z * c_1.z, y_1.w * c_1);
}

@compute @workgroup_size(WORKGROUP)
fn adam_sh_0(thread: Thread) {
    let id = thread_index(thread);
    if (id >= step.counts.x || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let g = sh_gradient(id);
    let stride = step.counts.y;
    let rest = vec4f(step.rates[3].y);
    update(id, sh_first(g.basis_0.a, g.basis_1.a, g.color_0, g.color_1), vec4f(vec3f(step.rates[3].x), rest.w));
    if (SH_DEGREE >= 1u) {
        update(stride + id, sh_second(g.basis_0.a, g.basis_1.a, g.color_0, g.color_1), rest);
        update(2u * stride + id, sh_third(g.basis_0.a, g.basis_1.a, g.color_0, g.color_1), rest);
    }
}

@compute @workgroup_size(WORKGROUP)
fn adam_sh_2(thread: Thread) {
    let id = thread_index(thread);
    if (id >= step.counts.x || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let g = sh_gradient(id);
    let stride = step.counts.y;
    let rate = vec4f(step.rates[3].y);
    update(id, sh_first(g.basis_0.b, g.basis_1.b, g.color_0, g.color_1), rate);
    update(stride + id, sh_second(g.basis_0.b, g.basis_1.b, g.color_0, g.color_1), rate);
    update(2u * stride + id, sh_third(g.basis_0.b, g.basis_1.b, g.color_0, g.color_1), rate);
    update(3u * stride + id, sh_first(g.basis_0.c, g.basis_1.c, g.color_0, g.color_1), rate);
}

@compute @workgroup_size(WORKGROUP)
fn adam_sh_3(thread: Thread) {
    let id = thread_index(thread);
    if (id >= step.counts.x || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let g = sh_gradient(id);
    let stride = step.counts.y;
    let rate = vec4f(step.rates[3].y);
    update(id, sh_second(g.basis_0.c, g.basis_1.c, g.color_0, g.color_1), rate);
    update(stride + id, sh_third(g.basis_0.c, g.basis_1.c, g.color_0, g.color_1), rate);
    update(2u * stride + id, sh_first(g.basis_0.d, g.basis_1.d, g.color_0, g.color_1), rate);
    update(3u * stride + id, sh_second(g.basis_0.d, g.basis_1.d, g.color_0, g.color_1), rate);
    update(4u * stride + id, sh_third(g.basis_0.d, g.basis_1.d, g.color_0, g.color_1), rate);
}
