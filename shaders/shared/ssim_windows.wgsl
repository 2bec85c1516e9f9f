// What every kernel of the image loss (1 - w) L1 + w (1 - SSIM) and of its gradient shares.
//
// SSIM is 3DGS's: 11x11 Gaussian window (sigma 1.5), per channel, zero outside the image. Under a
// mask pixel p has a weight m_p in [0, 1]: window weights are multiplied by it and normalised,
// and both means are weighted by it,
//   L1 = sum_p m_p |x_p - y_p| / sum_p m_p,  SSIM = sum_p m_p ssim_p / sum_p m_p,
// so pixels of weight 0 never matter and weights of 0 and 1 are a mask's.
//
// In terms of the residual e = x - y and with V the sum of both variances,
//   ssim = (1 - mu_e^2 / (mu_x^2 + mu_y^2 + C1)) (1 - var_e / (V + C2)).
// Variances are formed about the mean of the window's middle pixels, along one axis and then along the other: formed
// about 0 they would lose all their digits in flat windows. An edge in the middle costs few,
// because those pixels have the most weight: the variance is then as large as the square that is taken off.
// The gradient goes by y, whose factor is small where the images are alike, and by e less the mean
// residual of pixels nearby, so that a residual does not cancel that all pixels share.
#import shared/view
#import shared/loss

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> loss: Loss;

// What the L1 loss of the far pixels adds to the gradient of four pixels that are off by `e`.
fn far_gradient(texels: vec4u, e: vec4f) -> vec4f {
    return select(vec4f(0.0), loss.far_scale * sign(e), (texels >> vec4u(24u)) == vec4u(FAR_ALPHA));
}

// Gradient of the binary cross-entropy between opacity and subject, with respect to the opacity of four pixels of the image
// whose transmittance is `t`. What is drawn has an opacity of ALPHA_MIN or more.
fn silhouette_of(texels: vec4u, t: vec4f) -> vec4f {
    let subject = -1.0 / max(1.0 - t, vec4f(ALPHA_MIN));
    let beside = 1.0 / max(t, vec4f(TRANSMITTANCE_MIN));
    return loss.silhouette_scale * select(beside, subject, (texels >> vec4u(24u)) > vec4u(0u));
}

// SSIM of four windows, and what the gradient takes from each: a term of its own (with e less `residual`, that
// of pixels nearby), one times e and one times y.
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
