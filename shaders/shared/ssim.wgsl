// What the kernels of the image loss share that take four pixels side by side from memory.
#import shared/ssim_windows

@group(0) @binding(2) var<storage, read> rendered: array<vec4f>;
// RGBA8, rows as in a plane of `rendered`; alpha is the pixel's weight, 255 for 1, and FAR_ALPHA
// for a far one. With a silhouette 0 is beside the subject.
@group(0) @binding(3) var<storage, read> goal: array<vec4u>;
// Planes 3c..3c+2: what the loss's gradient takes from each window, channel c: a term of its own
// (with e less the residual of the four pixels), one times e and one times y.
@group(0) @binding(5) var<storage, read_write> derivatives: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> d_rendered: array<vec4f>;
// Per thread of the vertical passes: sum of SSIM, sum of |x - y|.
@group(0) @binding(7) var<storage, read_write> partials: array<vec2f>;

// Four texels of the goal; beside the padded image its rim, where weights are 0.
fn texels(x4: i32, y: u32) -> vec4u {
    return goal[y * view.row_vectors + u32(clamp(x4, 0, i32(view.row_vectors) - 1))];
}

fn channel_of(texels: vec4u, channel: u32) -> vec4f {
    return vec4f((texels >> vec4u(8u * channel)) & vec4u(255u)) / LEVEL_MAX;
}

// The pixels' weights: 0 outside the image; inside, 1 or, with a mask, what alpha says.
fn weights(texels: vec4u, x4: i32) -> vec4f {
    let x = vec4i(4 * x4) + vec4i(0, 1, 2, 3);
    let inside = (x >= vec4i(0)) & (x < vec4i(i32(view.size.x)));
    // A product, unlike a quotient, is exactly 1 for 255 on every driver.
    let masked = vec4f(texels >> vec4u(24u)) * (1.0 / LEVEL_MAX);
    let weight = select(masked, vec4f(1.0), vec4<bool>(loss.masked == 0u));
    return select(vec4f(0.0), weight, inside);
}

// The gradient of `silhouette_of` in the image, and 0 beside it.
fn silhouette_gradient(texels: vec4u, x4: u32, t: vec4f) -> vec4f {
    let inside = vec4u(4u * x4) + vec4u(0u, 1u, 2u, 3u) < vec4u(view.size.x);
    return select(vec4f(0.0), silhouette_of(texels, t), inside);
}

// Mean over the pixels that count; 0 if none does.
fn mean_of(e: vec4f, counts: vec4<bool>) -> f32 {
    let n = dot(select(vec4f(0.0), vec4f(1.0), counts), vec4f(1.0));
    return dot(select(vec4f(0.0), e, counts), vec4f(1.0)) / max(n, 1.0);
}

// Mean residual of four pixels.
fn residual_of(texels: vec4u, x4: i32, y: u32, channel: u32) -> f32 {
    let counts = weights(texels, x4) > vec4f(0.0);
    let e = rendered[plane_index(view, channel, u32(clamp(x4, 0, i32(view.row_vectors) - 1)), y)] - channel_of(texels, channel);
    return mean_of(e, counts);
}

// Means of e and y over four pixels or, where none of these counts, over their neighbours.
fn middle(before: vec3f, own: vec3f, after: vec3f) -> vec2f {
    let beside = (before.xy * before.z + after.xy * after.z) / max(before.z + after.z, 1.0);
    return select(beside, own.xy, own.z > 0.0);
}
