// Computes the image loss and its gradient (`shared/ssim.wgsl`) in four dispatches: horizontal moments, vertical moments with
// SSIM's derivatives, and the two passes back. A thread takes many pixels: for drivers that run on a CPU.
#import shared/thread
#import shared/ssim

const N_MOMENTS = 4u;
const NORM_PLANE = 12u;

// Planes 4c..4c+3, of a row of the window about each pixel, channel c: means of e and y, sum of the
// variances of x and y, variance of e; 12: weight. Later planes 3c..3c+2: horizontal sums of the
// derivatives.
@group(0) @binding(4) var<storage, read_write> moments: array<vec4f>;

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
    if (at.x4 + {j}u < view.row_vectors) {
        moments[plane_index(view, plane, at.x4 + {j}u, at.y)] = sums.v{j};
    }
    #end
}

struct Place {
    x4: u32,
    y: u32,
    channel: u32,
    inside: bool,
}

// One thread `across` vectors of four pixels of `rows` rows (and a channel).
fn place(index: u32, across: u32, rows: u32, channels: u32) -> Place {
    // All rows of the padded image, so that its padding carries no gradient.
    let n_rows = view.plane_vectors / (view.row_vectors * rows);
    let n_columns = (view.row_vectors + across - 1u) / across;
    let per_channel = n_columns * n_rows;
    let channel = index / per_channel;
    let rest = index % per_channel;
    return Place((rest % n_columns) * across, (rest / n_columns) * rows, channel, channel < channels);
}

// Means of e and y, sum of the variances of x and y, and variance of e in the rows of the windows
// about four pixels, from twenty: their weights `m`, and e and y less those of the middle four, `about`,
// which all the windows hold. `norm` is the rows' weight.
fn row_moments(m: Strip, e: Strip, y: Strip, about: vec2f, norm: vec4f) -> Quad {
    var m_e: Strip;
    var m_y: Strip;
    var both: Strip;
    var squares: Strip;
    #repeat b 5
    {
        let x = e.v{b} + y.v{b};
        m_e.v{b} = m.v{b} * e.v{b};
        m_y.v{b} = m.v{b} * y.v{b};
        squares.v{b} = m_e.v{b} * e.v{b};
        both.v{b} = m.v{b} * (x * x + y.v{b} * y.v{b});
    }
    #end
    let inv_norm = select(vec4f(0.0), 1.0 / norm, norm > vec4f(0.0));
    let mean_e = convolve(m_e) * inv_norm;
    let mean_y = convolve(m_y) * inv_norm;
    let mean_x = mean_e + mean_y;
    return Quad(
        about.x + mean_e,
        about.y + mean_y,
        convolve(both) * inv_norm - (mean_x * mean_x + mean_y * mean_y),
        convolve(squares) * inv_norm - mean_e * mean_e,
    );
}

fn less(s: Strip, x: f32) -> Strip {
    return Strip(s.v0 - x, s.v1 - x, s.v2 - x, s.v3 - x, s.v4 - x);
}

@compute @workgroup_size(WORKGROUP)
fn ssim_horizontal(thread: Thread) {
    let at = place(thread_index(thread), N_ACROSS, 1u, 1u);
    if (!at.inside || at.y >= view.size.y) {
        return;
    }
    // Beside the image all is 0; without a mask that counts in full.
    var m: Wide;
    #repeat b 8
    let raw_{b} = texels(i32(at.x4) + {b} - 2, at.y);
    let weight_{b} = weights(raw_{b}, i32(at.x4) + {b} - 2);
    m.v{b} = select(weight_{b}, vec4f(1.0), vec4<bool>(loss.masked == 0u));
    #end
    var norm = Quad(vec4f(1.0), vec4f(1.0), vec4f(1.0), vec4f(1.0));
    if (loss.masked != 0u) {
        norm = convolve_wide(m);
        keep_moments(NORM_PLANE, at, norm);
    }
    // bound: 3 turns.
    for (var channel = 0u; channel < 3u; channel++) {
        #repeat b 8
        let x4_{b} = u32(clamp(i32(at.x4) + {b} - 2, 0, i32(view.row_vectors) - 1));
        let counts_{b} = weight_{b} > vec4f(0.0);
        let goal_{b} = channel_of(raw_{b}, channel);
        let y_{b} = select(vec4f(0.0), goal_{b}, counts_{b});
        let e_{b} = select(vec4f(0.0), rendered[plane_index(view, channel, x4_{b}, at.y)] - goal_{b}, counts_{b});
        let means_{b} = vec3f(mean_of(e_{b}, counts_{b}), mean_of(y_{b}, counts_{b}), f32(any(counts_{b})));
        #end
        let about_0 = middle(means_1, means_2, means_3);
        let r_0 = row_moments(
            Strip(m.v0, m.v1, m.v2, m.v3, m.v4),
            less(Strip(e_0, e_1, e_2, e_3, e_4), about_0.x),
            less(Strip(y_0, y_1, y_2, y_3, y_4), about_0.y),
            about_0, norm.v0,
        );
        let about_1 = middle(means_2, means_3, means_4);
        let r_1 = row_moments(
            Strip(m.v1, m.v2, m.v3, m.v4, m.v5),
            less(Strip(e_1, e_2, e_3, e_4, e_5), about_1.x),
            less(Strip(y_1, y_2, y_3, y_4, y_5), about_1.y),
            about_1, norm.v1,
        );
        let about_2 = middle(means_3, means_4, means_5);
        let r_2 = row_moments(
            Strip(m.v2, m.v3, m.v4, m.v5, m.v6),
            less(Strip(e_2, e_3, e_4, e_5, e_6), about_2.x),
            less(Strip(y_2, y_3, y_4, y_5, y_6), about_2.y),
            about_2, norm.v2,
        );
        let about_3 = middle(means_4, means_5, means_6);
        let r_3 = row_moments(
            Strip(m.v3, m.v4, m.v5, m.v6, m.v7),
            less(Strip(e_3, e_4, e_5, e_6, e_7), about_3.x),
            less(Strip(y_3, y_4, y_5, y_6, y_7), about_3.y),
            about_3, norm.v3,
        );
        let plane = N_MOMENTS * channel;
        #repeat k 4
        keep_moments(plane + {k}u, at, Quad(r_0.v{k}, r_1.v{k}, r_2.v{k}, r_3.v{k}));
        #end
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

// The weight of a window's row.
fn row_weight(x4: u32, row: i32) -> vec4f {
    return select(row_or_zero(NORM_PLANE, x4, row), vec4f(1.0), vec4<bool>(loss.masked == 0u));
}

@compute @workgroup_size(WORKGROUP)
fn ssim_vertical(thread: Thread) {
    let at = place(thread_index(thread), 1u, SSIM_ROWS, 3u);
    if (!at.inside) {
        return;
    }
    let plane = N_MOMENTS * at.channel;
    // Means of a row of some weight, of those here the one nearest to the middle, which is in all
    // windows or most: what is summed up lies about them.
    var about_e = vec4f(0.0);
    var about_y = vec4f(0.0);
    #repeat i SSIM_ROWS
    {
        // From the outermost inwards: 0, 7, 1, 6, ...
        let r = select({i} / 2, i32(SSIM_ROWS) - 1 - {i} / 2, {i} % 2 == 1);
        let row = i32(at.y) + r;
        let counts = (row_weight(at.x4, row) > vec4f(0.0)) & vec4<bool>(row < i32(view.size.y));
        about_e = select(about_e, row_or_zero(plane, at.x4, row), counts);
        about_y = select(about_y, row_or_zero(plane + 1u, at.x4, row), counts);
    }
    #end
    var norm: Rows;
    var sum_e: Rows;
    var sum_y: Rows;
    var sum_both: Rows;
    var sum_residual: Rows;
    // Row i of the strip is tap i - r of output row r; WINDOW_PADDED is 0 beyond the window.
    #repeat i SSIM_STRIP
    {
        let row = i32(at.y) + {i} - 5;
        let n = row_weight(at.x4, row);
        let e = row_or_zero(plane, at.x4, row) - about_e;
        let y = row_or_zero(plane + 1u, at.x4, row) - about_y;
        let x = e + y;
        let n_e = n * e;
        let n_y = n * y;
        let n_both = n * (row_or_zero(plane + 2u, at.x4, row) + (x * x + y * y));
        let n_residual = n * (row_or_zero(plane + 3u, at.x4, row) + e * e);
        #repeat r SSIM_ROWS
        {
            let w = WINDOW_PADDED[{i} + SSIM_ROWS - 1 - {r}];
            norm.r{r} += w * n;
            sum_e.r{r} += w * n_e;
            sum_y.r{r} += w * n_y;
            sum_both.r{r} += w * n_both;
            sum_residual.r{r} += w * n_residual;
        }
        #end
    }
    #end
    var sum = vec4f(0.0);
    #repeat r SSIM_ROWS
    if (at.y + {r}u < view.size.y) {
        let raw = texels(i32(at.x4), at.y + {r}u);
        let weight = weights(raw, i32(at.x4));
        var inv_norm = vec4f(1.0);
        if (loss.masked != 0u) {
            inv_norm = select(vec4f(0.0), 1.0 / norm.r{r}, weight > vec4f(0.0));
        }
        let off_e = sum_e.r{r} * inv_norm;
        let off_y = sum_y.r{r} * inv_norm;
        let off_x = off_e + off_y;
        let mu_e = about_e + off_e;
        let mu_y = about_y + off_y;
        let var_both = max(sum_both.r{r} * inv_norm - (off_x * off_x + off_y * off_y), vec4f(0.0));
        let var_e = max(sum_residual.r{r} * inv_norm - off_e * off_e, vec4f(0.0));
        let residual = residual_of(raw, i32(at.x4), at.y + {r}u, at.channel);
        let w = windows(mu_e, mu_y, var_both, var_e, weight, inv_norm, residual);
        sum += weight * w.ssim;
        let base = 3u * at.channel;
        derivatives[plane_index(view, base, at.x4, at.y + {r}u)] = w.own;
        derivatives[plane_index(view, base + 1u, at.x4, at.y + {r}u)] = w.d_e;
        derivatives[plane_index(view, base + 2u, at.x4, at.y + {r}u)] = w.d_y;
    }
    #end
    let index = thread_index(thread);
    partials[index] = vec2f((sum.x + sum.y) + (sum.z + sum.w), 0.0);
}

// Terms whose residuals are less r_0..r_4, with those less `residual`.
fn about(residual: f32, own: Strip, d_e: Strip, r_0: f32, r_1: f32, r_2: f32, r_3: f32, r_4: f32) -> Strip {
    return Strip(
        own.v0 + d_e.v0 * (residual - r_0),
        own.v1 + d_e.v1 * (residual - r_1),
        own.v2 + d_e.v2 * (residual - r_2),
        own.v3 + d_e.v3 * (residual - r_3),
        own.v4 + d_e.v4 * (residual - r_4),
    );
}

@compute @workgroup_size(WORKGROUP)
fn ssim_horizontal_backward(thread: Thread) {
    let at = place(thread_index(thread), N_ACROSS, 1u, 1u);
    if (!at.inside || at.y >= view.size.y) {
        return;
    }
    // bound: 3 turns.
    for (var channel = 0u; channel < 3u; channel++) {
        var own: Wide;
        var d_e: Wide;
        var d_y: Wide;
        #repeat b 8
        let x4_{b} = i32(at.x4) + {b} - 2;
        if (x4_{b} >= 0 && x4_{b} < i32(view.row_vectors)) {
            own.v{b} = derivatives[plane_index(view, 3u * channel, u32(x4_{b}), at.y)];
            d_e.v{b} = derivatives[plane_index(view, 3u * channel + 1u, u32(x4_{b}), at.y)];
            d_y.v{b} = derivatives[plane_index(view, 3u * channel + 2u, u32(x4_{b}), at.y)];
        }
        let residual_{b} = residual_of(texels(x4_{b}, at.y), x4_{b}, at.y, channel);
        #end
        // From each window's residual to that of the pixels which take from it.
        let sums = Quad(
            convolve(about(residual_2, Strip(own.v0, own.v1, own.v2, own.v3, own.v4), Strip(d_e.v0, d_e.v1, d_e.v2, d_e.v3, d_e.v4),
                residual_0, residual_1, residual_2, residual_3, residual_4)),
            convolve(about(residual_3, Strip(own.v1, own.v2, own.v3, own.v4, own.v5), Strip(d_e.v1, d_e.v2, d_e.v3, d_e.v4, d_e.v5),
                residual_1, residual_2, residual_3, residual_4, residual_5)),
            convolve(about(residual_4, Strip(own.v2, own.v3, own.v4, own.v5, own.v6), Strip(d_e.v2, d_e.v3, d_e.v4, d_e.v5, d_e.v6),
                residual_2, residual_3, residual_4, residual_5, residual_6)),
            convolve(about(residual_5, Strip(own.v3, own.v4, own.v5, own.v6, own.v7), Strip(d_e.v3, d_e.v4, d_e.v5, d_e.v6, d_e.v7),
                residual_3, residual_4, residual_5, residual_6, residual_7)),
        );
        keep_moments(3u * channel, at, sums);
        keep_moments(3u * channel + 1u, at, convolve_wide(d_e));
        keep_moments(3u * channel + 2u, at, convolve_wide(d_y));
    }
}

@compute @workgroup_size(WORKGROUP)
fn ssim_vertical_backward(thread: Thread) {
    let at = place(thread_index(thread), 1u, SSIM_ROWS, 3u);
    if (!at.inside) {
        return;
    }
    let base = 3u * at.channel;
    // The residual of a row in the middle, of those with a pixel that counts.
    var residual = 0.0;
    #repeat i SSIM_ROWS
    {
        let row = at.y + select({i}u / 2u, SSIM_ROWS - 1u - {i}u / 2u, {i}u % 2u == 1u);
        if (row < view.size.y) {
            let raw = texels(i32(at.x4), row);
            if (any(weights(raw, i32(at.x4)) > vec4f(0.0))) {
                residual = residual_of(raw, i32(at.x4), row, at.channel);
            }
        }
    }
    #end
    var own: Rows;
    var d_e: Rows;
    #repeat i SSIM_STRIP
    {
        let row = i32(at.y) + {i} - 5;
        if (row >= 0 && row < i32(view.size.y)) {
            let of_row = residual_of(texels(i32(at.x4), u32(row)), i32(at.x4), u32(row), at.channel);
            let row_e = moments[plane_index(view, base + 1u, at.x4, u32(row))];
            let row_own = moments[plane_index(view, base, at.x4, u32(row))] + row_e * (residual - of_row);
            #repeat r SSIM_ROWS
            own.r{r} += WINDOW_PADDED[{i} + SSIM_ROWS - 1 - {r}] * row_own;
            d_e.r{r} += WINDOW_PADDED[{i} + SSIM_ROWS - 1 - {r}] * row_e;
            #end
        }
    }
    #end
    let d_y = convolve_columns(base + 2u, at.x4, at.y);
    // Without a silhouette the loss does not depend on the coverage. Planes lie elsewhere for a view of
    // another size, so what one has left here may be another's gradient.
    if (at.channel == 0u) {
        #repeat r SSIM_ROWS
        d_rendered[plane_index(view, 3u, at.x4, at.y + {r}u)] = vec4f(0.0);
        #end
    }
    if (at.channel == 0u && loss.silhouette_scale > 0.0) {
        #repeat r SSIM_ROWS
        if (at.y + {r}u < view.size.y) {
            let t = rendered[plane_index(view, 3u, at.x4, at.y + {r}u)];
            d_rendered[plane_index(view, 3u, at.x4, at.y + {r}u)] = silhouette_gradient(texels(i32(at.x4), at.y + {r}u), at.x4, t);
        }
        #end
    }
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
        let d_ssim = weight * (own.r{r} + ((x - y) - residual) * d_e.r{r} + y * d_y.r{r});
        var gradient = d_ssim + loss.l1_scale * (weight * sign(difference));
        if (loss.far_scale > 0.0) {
            gradient += far_gradient(raw, x - y);
        }
        d_rendered[plane_index(view, at.channel, at.x4, at.y + {r}u)] = gradient;
    }
    #end
    let index = thread_index(thread);
    partials[index].y = (sum.x + sum.y) + (sum.z + sum.w);
}
