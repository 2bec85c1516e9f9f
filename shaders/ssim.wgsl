// The image loss (1 - w) L1 + w (1 - SSIM) and its gradient, in four dispatches: horizontal
// moments, vertical moments with SSIM's derivatives, and the two passes back.
//
// SSIM is 3DGS's: 11x11 Gaussian window (sigma 1.5), per channel, zero outside the image. Under a
// mask pixel p has a weight m_p in [0, 1]: window weights are multiplied by it and normalised,
// and both means are weighted by it,
//   L1 = sum_p m_p |x_p - y_p| / sum_p m_p,  SSIM = sum_p m_p ssim_p / sum_p m_p,
// so pixels of weight 0 never matter and weights of 0 and 1 are a mask's.
#import shared/view
#import shared/loss

const N_MOMENTS = 4u;
const NORM_PLANE = 12u;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> loss: Loss;
@group(0) @binding(2) var<storage, read> rendered: array<vec4f>;
// RGBA8, rows as in a plane of `rendered`; alpha is the pixel's weight, 255 for 1.
@group(0) @binding(3) var<storage, read> goal: array<vec4u>;
// Planes 4c..4c+3: horizontal moments x, y, xx + yy, xy of channel c (SSIM needs the variances'
// sum alone); 12: window weight. Later
// planes 3c..3c+2: horizontal sums of the derivatives.
@group(0) @binding(4) var<storage, read_write> moments: array<vec4f>;
// Planes 3c..3c+2: derivative of the loss to the moments x, xx, xy of channel c.
@group(0) @binding(5) var<storage, read_write> derivatives: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> d_rendered: array<vec4f>;
// Per thread of the vertical passes: sum of SSIM, sum of |x - y|.
@group(0) @binding(7) var<storage, read_write> partials: array<vec2f>;

// Vectors of four pixels that a thread of the horizontal passes covers.
const N_ACROSS = 4u;

// 20 pixels of a row: from 8 before four pixels to 8 after.
struct Strip {
    #repeat b 5
    v{b}: vec4f,
    #end
}

// 32 pixels of a row: from 8 before the thread's sixteen to 8 after.
struct Wide {
    #repeat b 8
    v{b}: vec4f,
    #end
}

// Sums for the thread's sixteen pixels.
struct Quad {
    #repeat j 4
    v{j}: vec4f,
    #end
}

// The four pixels `k - 5` to the right of the thread's own.
fn tap_0(s: Strip) -> vec4f { return vec4f(s.v0.w, s.v1.xyz); }
fn tap_1(s: Strip) -> vec4f { return s.v1; }
fn tap_2(s: Strip) -> vec4f { return vec4f(s.v1.yzw, s.v2.x); }
fn tap_3(s: Strip) -> vec4f { return vec4f(s.v1.zw, s.v2.xy); }
fn tap_4(s: Strip) -> vec4f { return vec4f(s.v1.w, s.v2.xyz); }
fn tap_5(s: Strip) -> vec4f { return s.v2; }
fn tap_6(s: Strip) -> vec4f { return vec4f(s.v2.yzw, s.v3.x); }
fn tap_7(s: Strip) -> vec4f { return vec4f(s.v2.zw, s.v3.xy); }
fn tap_8(s: Strip) -> vec4f { return vec4f(s.v2.w, s.v3.xyz); }
fn tap_9(s: Strip) -> vec4f { return s.v3; }
fn tap_10(s: Strip) -> vec4f { return vec4f(s.v3.yzw, s.v4.x); }

// The window is symmetric.
fn convolve(s: Strip) -> vec4f {
    return WINDOW[5] * tap_5(s) + WINDOW[4] * (tap_4(s) + tap_6(s)) + WINDOW[3] * (tap_3(s) + tap_7(s))
        + WINDOW[2] * (tap_2(s) + tap_8(s)) + WINDOW[1] * (tap_1(s) + tap_9(s)) + WINDOW[0] * (tap_0(s) + tap_10(s));
}

fn convolve_wide(w: Wide) -> Quad {
    return Quad(
        convolve(Strip(w.v0, w.v1, w.v2, w.v3, w.v4)),
        convolve(Strip(w.v1, w.v2, w.v3, w.v4, w.v5)),
        convolve(Strip(w.v2, w.v3, w.v4, w.v5, w.v6)),
        convolve(Strip(w.v3, w.v4, w.v5, w.v6, w.v7)),
    );
}

// Keeps the part of `sums` that lies in the padded image.
fn keep_moments(plane: u32, at: Place, sums: Quad) {
    #repeat j 4
    if (at.x4 + {j}u < view.planes.y) {
        moments[plane_index(view, plane, at.x4 + {j}u, at.y)] = sums.v{j};
    }
    #end
}

// Four texels of the goal; beside the padded image its rim, where weights are 0.
fn texels(x4: i32, y: u32) -> vec4u {
    return goal[y * view.planes.y + u32(clamp(x4, 0, i32(view.planes.y) - 1))];
}

fn channel_of(texels: vec4u, channel: u32) -> vec4f {
    return vec4f((texels >> vec4u(8u * channel)) & vec4u(255u)) / 255.0;
}

// The pixels' weights: 0 outside the image; inside, 1 or, with a mask, what alpha says.
fn weights(texels: vec4u, x4: i32) -> vec4f {
    let x = vec4i(4 * x4) + vec4i(0, 1, 2, 3);
    let inside = (x >= vec4i(0)) & (x < vec4i(i32(view.size.x)));
    // A product, unlike a quotient, is exactly 1 for 255 on every driver.
    let masked = vec4f(texels >> vec4u(24u)) * (1.0 / 255.0);
    let weight = select(masked, vec4f(1.0), vec4<bool>(loss.masked == 0u));
    return select(vec4f(0.0), weight, inside);
}

struct Place {
    x4: u32,
    y: u32,
    channel: u32,
    inside: bool,
}

// One thread `across` vectors of four pixels of `rows` rows (and a channel).
fn place(group: vec3u, groups: vec3u, local: u32, across: u32, rows: u32, channels: u32) -> Place {
    let index = (group.y * groups.x + group.x) * WORKGROUP + local;
    // All rows of the padded image, so that its padding carries no gradient.
    let n_rows = view.planes.x / (view.planes.y * rows);
    let n_columns = (view.planes.y + across - 1u) / across;
    let per_channel = n_columns * n_rows;
    let channel = index / per_channel;
    let rest = index % per_channel;
    return Place((rest % n_columns) * across, (rest / n_columns) * rows, channel, channel < channels);
}

@compute @workgroup_size(WORKGROUP)
fn ssim_horizontal(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let at = place(group, groups, local, N_ACROSS, 1u, 1u);
    if (!at.inside || at.y >= view.size.y) {
        return;
    }
    var m: Wide;
    #repeat b 8
    let raw_{b} = texels(i32(at.x4) + {b} - 2, at.y);
    m.v{b} = weights(raw_{b}, i32(at.x4) + {b} - 2);
    #end
    if (loss.masked != 0u) {
        keep_moments(NORM_PLANE, at, convolve_wide(m));
    }
    // bound: 3 turns.
    for (var channel = 0u; channel < 3u; channel++) {
        var x: Wide;
        var y: Wide;
        var squares: Wide;
        var product: Wide;
        #repeat b 8
        {
            let x4 = u32(clamp(i32(at.x4) + {b} - 2, 0, i32(view.planes.y) - 1));
            let v_x = rendered[plane_index(view, channel, x4, at.y)];
            let v_y = channel_of(raw_{b}, channel);
            x.v{b} = m.v{b} * v_x;
            y.v{b} = m.v{b} * v_y;
            squares.v{b} = x.v{b} * v_x + y.v{b} * v_y;
            product.v{b} = x.v{b} * v_y;
        }
        #end
        let plane = N_MOMENTS * channel;
        keep_moments(plane, at, convolve_wide(x));
        keep_moments(plane + 1u, at, convolve_wide(y));
        keep_moments(plane + 2u, at, convolve_wide(squares));
        keep_moments(plane + 3u, at, convolve_wide(product));
    }
}

// Rows of sums, SSIM_ROWS of them.
struct Rows {
    #repeat r SSIM_ROWS
    r{r}: vec4f,
    #end
}

fn row_or_zero(plane: u32, x4: u32, row: i32) -> vec4f {
    if (row < 0 || row >= i32(view.size.y)) {
        return vec4f(0.0);
    }
    return moments[plane_index(view, plane, x4, u32(row))];
}

// Vertical window sums of one plane for SSIM_ROWS rows from `y` down.
fn convolve_columns(plane: u32, x4: u32, y: u32) -> Rows {
    var sums: Rows;
    // Row i of the strip is tap i - r of output row r; WINDOW_PADDED is 0 beyond the window.
    #repeat i SSIM_STRIP
    {
        let v = row_or_zero(plane, x4, i32(y) + {i} - 5);
        #repeat r SSIM_ROWS
        sums.r{r} += WINDOW_PADDED[{i} + SSIM_ROWS - 1 - {r}] * v;
        #end
    }
    #end
    return sums;
}

@compute @workgroup_size(WORKGROUP)
fn ssim_vertical(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let at = place(group, groups, local, 1u, SSIM_ROWS, 3u);
    if (!at.inside) {
        return;
    }
    let plane = N_MOMENTS * at.channel;
    let m_x = convolve_columns(plane, at.x4, at.y);
    let m_y = convolve_columns(plane + 1u, at.x4, at.y);
    let m_squares = convolve_columns(plane + 2u, at.x4, at.y);
    let m_xy = convolve_columns(plane + 3u, at.x4, at.y);
    var norm: Rows;
    if (loss.masked != 0u) {
        norm = convolve_columns(NORM_PLANE, at.x4, at.y);
    }
    var sum = vec4f(0.0);
    #repeat r SSIM_ROWS
    if (at.y + {r}u < view.size.y) {
        let weight = weights(texels(i32(at.x4), at.y + {r}u), i32(at.x4));
        var inv_norm = vec4f(1.0);
        if (loss.masked != 0u) {
            inv_norm = select(vec4f(0.0), 1.0 / norm.r{r}, weight > vec4f(0.0));
        }
        let mu_x = m_x.r{r} * inv_norm;
        let mu_y = m_y.r{r} * inv_norm;
        let mu_squares = mu_x * mu_x + mu_y * mu_y;
        // Of both images together.
        let variance = m_squares.r{r} * inv_norm - mu_squares;
        let cov = m_xy.r{r} * inv_norm - mu_x * mu_y;
        let n_1 = 2.0 * mu_x * mu_y + SSIM_C1;
        let n_2 = 2.0 * cov + SSIM_C2;
        let d_1 = mu_squares + SSIM_C1;
        let d_2 = variance + SSIM_C2;
        let inv = 1.0 / (d_1 * d_2);
        let s = n_1 * n_2 * inv;
        sum += weight * s;
        let scale = -loss.ssim_scale * weight * inv_norm;
        let d_var = -s / d_2;
        let d_cov = 2.0 * n_1 * inv;
        let d_mu = 2.0 * (mu_y * n_2 * inv - mu_x * s / d_1) - 2.0 * mu_x * d_var - mu_y * d_cov;
        let base = 3u * at.channel;
        derivatives[plane_index(view, base, at.x4, at.y + {r}u)] = scale * d_mu;
        derivatives[plane_index(view, base + 1u, at.x4, at.y + {r}u)] = scale * d_var;
        derivatives[plane_index(view, base + 2u, at.x4, at.y + {r}u)] = scale * d_cov;
    }
    #end
    let index = (group.y * groups.x + group.x) * WORKGROUP + local;
    partials[index] = vec2f((sum.x + sum.y) + (sum.z + sum.w), 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn ssim_horizontal_backward(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let at = place(group, groups, local, N_ACROSS, 1u, 1u);
    if (!at.inside || at.y >= view.size.y) {
        return;
    }
    // bound: 9 turns.
    for (var plane = 0u; plane < 9u; plane++) {
        var w: Wide;
        #repeat b 8
        if (i32(at.x4) + {b} - 2 >= 0 && at.x4 + {b}u < view.planes.y + 2u) {
            w.v{b} = derivatives[plane_index(view, plane, at.x4 + {b}u - 2u, at.y)];
        }
        #end
        keep_moments(plane, at, convolve_wide(w));
    }
}

@compute @workgroup_size(WORKGROUP)
fn ssim_vertical_backward(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let at = place(group, groups, local, 1u, SSIM_ROWS, 3u);
    if (!at.inside) {
        return;
    }
    let base = 3u * at.channel;
    let d_mu = convolve_columns(base, at.x4, at.y);
    let d_xx = convolve_columns(base + 1u, at.x4, at.y);
    let d_xy = convolve_columns(base + 2u, at.x4, at.y);
    var sum = vec4f(0.0);
    #repeat r SSIM_ROWS
    if (at.y + {r}u >= view.size.y) {
        d_rendered[plane_index(view, at.channel, at.x4, at.y + {r}u)] = vec4f(0.0);
    } else {
        let raw = texels(i32(at.x4), at.y + {r}u);
        let weight = weights(raw, i32(at.x4));
        let x = rendered[plane_index(view, at.channel, at.x4, at.y + {r}u)];
        let y = channel_of(raw, at.channel);
        let difference = weight * (x - y);
        sum += abs(difference);
        let d_ssim = weight * (d_mu.r{r} + 2.0 * x * d_xx.r{r} + y * d_xy.r{r});
        d_rendered[plane_index(view, at.channel, at.x4, at.y + {r}u)] = d_ssim + loss.l1_scale * (weight * sign(difference));
    }
    #end
    let index = (group.y * groups.x + group.x) * WORKGROUP + local;
    partials[index].y = (sum.x + sum.y) + (sum.z + sum.w);
}
