// What the kernels of the image loss (1 - w) L1 + w (1 - SSIM) and of its gradient share.
//
// SSIM is 3DGS's: 11x11 Gaussian window (sigma 1.5), per channel, zero outside the image. Under a
// mask pixel p has a weight m_p in [0, 1]: window weights are multiplied by it and normalised,
// and both means are weighted by it,
//   L1 = sum_p m_p |x_p - y_p| / sum_p m_p,  SSIM = sum_p m_p ssim_p / sum_p m_p,
// so pixels of weight 0 never matter and weights of 0 and 1 are a mask's.
//
// In terms of the residual e = x - y and with V the sum of both variances,
//   ssim = (1 - mu_e^2 / (mu_x^2 + mu_y^2 + C1)) (1 - var_e / (V + C2)).
// Variances are formed about the mean of the window's middle pixels, row by row, and then of the rows:
// formed about 0 they would lose all their digits in flat windows. An edge in the middle costs few,
// because those pixels have the most weight: the variance is then as large as the square that is taken off.
// The gradient goes by y, whose factor is small where the images are alike, and by e less the mean
// residual of four pixels nearby, so that a residual does not cancel that all pixels share.
#import shared/view
#import shared/loss

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> loss: Loss;
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

// What the L1 loss of the far pixels adds to the gradient of four pixels that are off by `e`.
fn far_gradient(texels: vec4u, e: vec4f) -> vec4f {
    return select(vec4f(0.0), loss.far_scale * sign(e), (texels >> vec4u(24u)) == vec4u(FAR_ALPHA));
}

// Gradient of the binary cross-entropy between opacity and subject, with respect to the opacity of four pixels
// whose transmittance is `t`. What is drawn has an opacity of ALPHA_MIN or more.
fn silhouette_gradient(texels: vec4u, x4: u32, t: vec4f) -> vec4f {
    let inside = vec4u(4u * x4) + vec4u(0u, 1u, 2u, 3u) < vec4u(view.size.x);
    let subject = -1.0 / max(1.0 - t, vec4f(ALPHA_MIN));
    let beside = 1.0 / max(t, vec4f(TRANSMITTANCE_MIN));
    let gradient = select(beside, subject, (texels >> vec4u(24u)) > vec4u(0u));
    return select(vec4f(0.0), loss.silhouette_scale * gradient, inside);
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

// SSIM of four windows, and what the gradient takes from each: a term of its own (with e less `residual`, that
// of the four pixels), one times e and one times y.
struct Windows {
    ssim: vec4f,
    own: vec4f,
    d_e: vec4f,
    d_y: vec4f,
}

// `mu_e` and `mu_y` are means of e and y in the windows; the variances are the sum of those of x and y, and that of e.
fn windows(mu_e: vec4f, mu_y: vec4f, var_both: vec4f, var_e: vec4f, weight: vec4f, inv_norm: vec4f, residual: f32) -> Windows {
    let mu_x = mu_e + mu_y;
    let inv_1 = 1.0 / (mu_x * mu_x + mu_y * mu_y + SSIM_C1);
    let inv_2 = 1.0 / (var_both + SSIM_C2);
    let dimmer = mu_e * mu_e * inv_1;
    let luminance = (2.0 * mu_x * mu_y + SSIM_C1) * inv_1;
    let contrast = 1.0 - var_e * inv_2;
    let s = luminance * contrast;
    let scale = -loss.ssim_scale * weight * inv_norm;
    let d_e = -2.0 * s * inv_2;
    let d_y = 2.0 * luminance * var_e * inv_2 * inv_2;
    let d_mu = 2.0 * contrast * inv_1 * (mu_y * dimmer - mu_e * luminance);
    let off_residual = mu_e - residual;
    return Windows(s, scale * (d_mu - d_e * off_residual - d_y * mu_y), scale * d_e, scale * d_y);
}

// Means of e and y over four pixels or, where none of these counts, over their neighbours.
fn middle(before: vec3f, own: vec3f, after: vec3f) -> vec2f {
    let beside = (before.xy * before.z + after.xy * after.z) / max(before.z + after.z, 1.0);
    return select(beside, own.xy, own.z > 0.0);
}
