// Takes one step of Adam (Kingma and Ba 2015; bias-corrected, epsilon added to the root, as PyTorch):
// one thread a Gaussian. SH gradients are never stored: coefficient k gets basis_k(direction)
// times the view's colour gradient, summed over the step's views here.
#import shared/thread
#import shared/sh
#import shared/on_screen

// One of a step's views.
struct StepView {
    // Optical centre, and the digits of it that f32 has no room for.
    center: vec3f,
    // 1 where the view takes part, else 0.
    weight: f32,
    center_low: vec3f,
    pad: f32,
}

struct Step {
    views: array<StepView, 2>,
    // Learning rates of the geometry's planes, of SH degree 0 and of higher ones.
    geometry_rates: array<vec4f, 3>,
    sh_0_rate: f32,
    sh_rate: f32,
    // Weight of the least scale of each Gaussian that is drawn.
    flat_weight: f32,
    pad_0: f32,
    beta_1: f32,
    beta_2: f32,
    // 1 - beta_1 and 1 - beta_2, which would lose three digits here.
    new_share_1: f32,
    new_share_2: f32,
    // 1 / (1 - beta_1^t) and 1 / sqrt(1 - beta_2^t).
    correction_1: f32,
    correction_2: f32,
    epsilon: f32,
    // 1 where positions have rates of their own, else 0.
    own_rates: u32,
    // Distance from the focus beyond which a Gaussian's geometry is frozen.
    frozen_beyond: f32,
    pad_2: f32,
    pad_3: f32,
    pad_4: f32,
    n_gaussians: u32,
    // Entries a plane.
    stride: u32,
    pad_5: u32,
    pad_6: u32,
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
// What densification gathers: sum of `gradient`, number of views drawn in, largest `radius`. They
// belong to the step that is taken, not to the view: a step that is repeated because its
// pairs did not fit counts once. The last number stays as it is: with `own_rates` the position's rate
// is multiplied by 1 plus it.
@group(0) @binding(9) var<storage, read_write> statistics: array<vec4f>;

fn update(index: u32, gradient: vec4f, rate: vec4f) {
    let m = step.beta_1 * first_moment[index] + step.new_share_1 * gradient;
    let v = step.beta_2 * second_moment[index] + step.new_share_2 * (gradient * gradient);
    first_moment[index] = m;
    second_moment[index] = v;
    parameters[index] -= rate * (m * step.correction_1) / (sqrt(v) * step.correction_2 + step.epsilon);
}

// Gradient of the weighted least scale, the first of equal ones, by the scales' logarithms.
fn flattening(scale_log: vec3f) -> vec3f {
    let least = min(scale_log.x, min(scale_log.y, scale_log.z));
    let slope = step.flat_weight * exp(least);
    if (scale_log.x == least) {
        return vec3f(slope, 0.0, 0.0);
    }
    return select(vec3f(0.0, 0.0, slope), vec3f(0.0, slope, 0.0), scale_log.y == least);
}

@compute @workgroup_size(WORKGROUP)
fn adam_geometry(thread: Thread) {
    let id = thread_index(thread);
    if (id >= step.n_gaussians || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let frozen = length(parameters[id].xyz) > step.frozen_beyond;
    var position_factor = 1.0;
    if (step.own_rates != 0u) {
        position_factor = 1.0 + statistics[id].w;
    }
    let seen = on_screen(screen[id]);
    // bound: 3 turns.
    for (var plane = 0u; plane < 3u; plane++) {
        let index = plane * step.stride + id;
        var gradient = source[index];
        if (plane == 1u && step.flat_weight > 0.0 && seen.radius > 0.0) {
            gradient += vec4f(flattening(parameters[index].xyz), 0.0);
        }
        let factor = select(vec4f(1.0), vec4f(vec3f(position_factor), 1.0), plane == 0u);
        update(index, gradient, select(factor * step.geometry_rates[plane], vec4f(0.0), frozen));
    }
    if (seen.radius > 0.0) {
        let old = statistics[id];
        statistics[id] = vec4f(old.x + seen.gradient, old.y + 1.0, max(old.z, seen.radius), old.w);
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
    let offset_0 = (mean - step.views[0].center) - step.views[0].center_low;
    let offset_1 = (mean - step.views[1].center) - step.views[1].center_low;
    return ShGradient(
        sh_basis(offset_0 / max(length(offset_0), 1e-30)),
        sh_basis(offset_1 / max(length(offset_1), 1e-30)),
        d_color[id].xyz * step.views[0].weight,
        d_color[step.stride + id].xyz * step.views[1].weight,
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
    if (id >= step.n_gaussians || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let g = sh_gradient(id);
    let stride = step.stride;
    let rest = vec4f(step.sh_rate);
    update(id, sh_first(g.basis_0.a, g.basis_1.a, g.color_0, g.color_1), vec4f(vec3f(step.sh_0_rate), rest.w));
    if (SH_DEGREE >= 1u) {
        update(stride + id, sh_second(g.basis_0.a, g.basis_1.a, g.color_0, g.color_1), rest);
        update(2u * stride + id, sh_third(g.basis_0.a, g.basis_1.a, g.color_0, g.color_1), rest);
    }
}

@compute @workgroup_size(WORKGROUP)
fn adam_sh_2(thread: Thread) {
    let id = thread_index(thread);
    if (id >= step.n_gaussians || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let g = sh_gradient(id);
    let stride = step.stride;
    let rate = vec4f(step.sh_rate);
    update(id, sh_first(g.basis_0.b, g.basis_1.b, g.color_0, g.color_1), rate);
    update(stride + id, sh_second(g.basis_0.b, g.basis_1.b, g.color_0, g.color_1), rate);
    update(2u * stride + id, sh_third(g.basis_0.b, g.basis_1.b, g.color_0, g.color_1), rate);
    update(3u * stride + id, sh_first(g.basis_0.c, g.basis_1.c, g.color_0, g.color_1), rate);
}

@compute @workgroup_size(WORKGROUP)
fn adam_sh_3(thread: Thread) {
    let id = thread_index(thread);
    if (id >= step.n_gaussians || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let g = sh_gradient(id);
    let stride = step.stride;
    let rate = vec4f(step.sh_rate);
    update(id, sh_second(g.basis_0.c, g.basis_1.c, g.color_0, g.color_1), rate);
    update(stride + id, sh_third(g.basis_0.c, g.basis_1.c, g.color_0, g.color_1), rate);
    update(2u * stride + id, sh_first(g.basis_0.d, g.basis_1.d, g.color_0, g.color_1), rate);
    update(3u * stride + id, sh_second(g.basis_0.d, g.basis_1.d, g.color_0, g.color_1), rate);
    update(4u * stride + id, sh_third(g.basis_0.d, g.basis_1.d, g.color_0, g.color_1), rate);
}
