// Computes the image loss and its gradient (`shared/ssim.wgsl`) in four dispatches: horizontal moments, vertical moments with
// SSIM's derivatives, and the two passes back. A thread goes along a row or down a column of vectors and holds what the next
// windows reach: for drivers that run on a CPU, where loads are dear. Its loops are short texts, as such a driver compiles a
// kernel when it first runs.
#import shared/thread
#import shared/ssim

// Rows of a window before or behind its middle one.
const REACH = i32(LOSS_MARGIN) / 2;
const N_MOMENTS = 4u;
const NORM_PLANE = 12u;

// Planes 4c..4c+3, of a row of the window about each pixel, channel c: means of e and y, sum of the
// variances of x and y, variance of e; 12: weight. Later planes 3c..3c+2: horizontal sums of the
// derivatives.
@group(0) @binding(4) var<storage, read_write> moments: array<vec4f>;

// 20 pixels of a row: from 8 before four pixels to 8 after.
struct Strip {
    #repeat b 5
    v{b}: vec4f,
    #end
}

// The four pixels `k - 5` to the right of those in the middle.
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

// A thread begins at this vector of this row and channel, if it has one at all.
struct Place {
    x4: u32,
    y: u32,
    channel: u32,
    inside: bool,
}

// All rows of the padded image, so that its padding carries no gradient.
fn padded_rows() -> u32 {
    return view.plane_vectors / view.row_vectors;
}

// One thread a channel and `across` vectors of four pixels of `rows` rows.
fn place(index: u32, across: u32, rows: u32) -> Place {
    let n_rows = (padded_rows() + rows - 1u) / rows;
    let n_columns = (view.row_vectors + across - 1u) / across;
    let per_channel = n_columns * n_rows;
    let channel = index / per_channel;
    let rest = index % per_channel;
    return Place((rest % n_columns) * across, (rest / n_columns) * rows, channel, channel < 3u);
}

// One past the last of the SSIM_ACROSS vectors from `x4` on.
fn end_across(x4: u32) -> u32 {
    return min(x4 + SSIM_ACROSS, view.row_vectors);
}

// One past the last of the SSIM_ROWS rows from `y` down.
fn end_of_strip(y: u32) -> u32 {
    return min(y + SSIM_ROWS, padded_rows());
}

// Four pixels side by side.
struct Pixels {
    // What windows weigh them by.
    m: vec4f,
    e: vec4f,
    y: vec4f,
    // Means of e and y, and whether any of the pixels counts.
    means: vec3f,
}

// Beside the image all is 0; without a mask that counts in full.
fn pixels_at(channel: u32, x4: i32, row: u32) -> Pixels {
    let raw = texels(x4, row);
    let weight = weights(raw, x4);
    let counts = weight > vec4f(0.0);
    let goal = channel_of(raw, channel);
    let x = rendered[plane_index(view, channel, u32(clamp(x4, 0, i32(view.row_vectors) - 1)), row)];
    let e = select(vec4f(0.0), x - goal, counts);
    let y = select(vec4f(0.0), goal, counts);
    let means = vec3f(mean_of(e, counts), mean_of(y, counts), f32(any(counts)));
    return Pixels(select(weight, vec4f(1.0), vec4<bool>(loss.masked == 0u)), e, y, means);
}

// A thread goes along SSIM_ACROSS vectors of a row, with all that their windows reach at hand.
@compute @workgroup_size(WORKGROUP)
fn ssim_horizontal(thread: Thread) {
    let at = place(thread_index(thread), SSIM_ACROSS, 1u);
    if (!at.inside || at.y >= view.size.y) {
        return;
    }
    var row: array<Pixels, 5>;
    // The next vector to be read.
    var next = i32(at.x4) - 2;
    // bound: SSIM_ACROSS turns.
    for (var x4 = at.x4; x4 < end_across(at.x4); x4++) {
        // bound: 5 turns, later 1.
        for (; next < i32(x4) + 3; next++) {
            #repeat b 4
            row[{b}] = row[{b} + 1];
            #end
            row[4] = pixels_at(at.channel, next, at.y);
        }
        let m = Strip(row[0].m, row[1].m, row[2].m, row[3].m, row[4].m);
        var norm = vec4f(1.0);
        if (loss.masked != 0u) {
            norm = convolve(m);
            if (at.channel == 0u) {
                moments[plane_index(view, NORM_PLANE, x4, at.y)] = norm;
            }
        }
        // Sums of e and y are formed about means which all the windows hold.
        let about = middle(row[1].means, row[2].means, row[3].means);
        var m_e: Strip;
        var m_y: Strip;
        var both: Strip;
        var squares: Strip;
        #repeat b 5
        {
            let e = row[{b}].e - about.x;
            let y = row[{b}].y - about.y;
            let x = e + y;
            m_e.v{b} = m.v{b} * e;
            m_y.v{b} = m.v{b} * y;
            squares.v{b} = m_e.v{b} * e;
            both.v{b} = m.v{b} * (x * x + y * y);
        }
        #end
        let inv_norm = select(vec4f(0.0), 1.0 / norm, norm > vec4f(0.0));
        let mean_e = convolve(m_e) * inv_norm;
        let mean_y = convolve(m_y) * inv_norm;
        let mean_x = mean_e + mean_y;
        let plane = N_MOMENTS * at.channel;
        moments[plane_index(view, plane, x4, at.y)] = about.x + mean_e;
        moments[plane_index(view, plane + 1u, x4, at.y)] = about.y + mean_y;
        moments[plane_index(view, plane + 2u, x4, at.y)] = convolve(both) * inv_norm - (mean_x * mean_x + mean_y * mean_y);
        moments[plane_index(view, plane + 3u, x4, at.y)] = convolve(squares) * inv_norm - mean_e * mean_e;
    }
}

// Sums of a turn's windows, row by row.
struct Rows {
    #repeat r SSIM_TURN
    r{r}: vec4f,
    #end
}

// What the horizontal pass has of a row of four windows side by side, with `weight`.
struct RowMoments {
    weight: vec4f,
    mean_e: vec4f,
    mean_y: vec4f,
    both: vec4f,
    squares: vec4f,
    counts: vec4<bool>,
}

fn is_row(row: i32) -> bool {
    return row >= 0 && row < i32(view.size.y);
}

// Beside the image all is 0; without a mask that counts in full, but for its means.
fn row_moments_at(channel: u32, x4: u32, row: i32) -> RowMoments {
    var of_row: RowMoments;
    if (is_row(row)) {
        let y = u32(row);
        let plane = N_MOMENTS * channel;
        of_row.mean_e = moments[plane_index(view, plane, x4, y)];
        of_row.mean_y = moments[plane_index(view, plane + 1u, x4, y)];
        of_row.both = moments[plane_index(view, plane + 2u, x4, y)];
        of_row.squares = moments[plane_index(view, plane + 3u, x4, y)];
        if (loss.masked != 0u) {
            of_row.weight = moments[plane_index(view, NORM_PLANE, x4, y)];
        }
    }
    of_row.weight = select(of_row.weight, vec4f(1.0), vec4<bool>(loss.masked == 0u));
    of_row.counts = (of_row.weight > vec4f(0.0)) & vec4<bool>(is_row(row));
    return of_row;
}

// Means of e and y that sums are formed about.
struct About {
    e: vec4f,
    y: vec4f,
}

// Those of a row of some weight, else those of before.
fn nearer(before: About, row: RowMoments) -> About {
    return About(select(before.e, row.mean_e, row.counts), select(before.y, row.mean_y, row.counts));
}

// A thread goes down SSIM_ROWS rows, SSIM_TURN at a time, with the rows of all their windows at hand.
@compute @workgroup_size(WORKGROUP)
fn ssim_vertical(thread: Thread) {
    let at = place(thread_index(thread), 1u, SSIM_ROWS);
    if (!at.inside) {
        return;
    }
    var rows: array<RowMoments, SSIM_RING>;
    // The next row to be read.
    var next = i32(at.y) - REACH;
    var sum = vec4f(0.0);
    // bound: SSIM_ROWS / SSIM_TURN turns.
    for (var top = at.y; top < end_of_strip(at.y); top += SSIM_TURN) {
        // bound: SSIM_RING / SSIM_TURN turns, later 1.
        for (; next < i32(top + SSIM_TURN) + REACH; next += i32(SSIM_TURN)) {
            #repeat i LOSS_MARGIN
            rows[{i}] = rows[{i} + SSIM_TURN];
            #end
            #repeat i SSIM_TURN
            rows[{i} + LOSS_MARGIN] = row_moments_at(at.channel, at.x4, next + {i});
            #end
        }
        // Those of a row of the turn, which all windows hold: of the second, if it counts.
        let about = nearer(nearer(About(), rows[REACH]), rows[REACH + 1]);
        var norm: Rows;
        var sum_e: Rows;
        var sum_y: Rows;
        var sum_both: Rows;
        var sum_squares: Rows;
        // Row i is tap i - r of output row r; WINDOW_PADDED is 0 beyond the window.
        #repeat i SSIM_RING
        {
            let n = rows[{i}].weight;
            let e = rows[{i}].mean_e - about.e;
            let y = rows[{i}].mean_y - about.y;
            let x = e + y;
            let n_e = n * e;
            let n_y = n * y;
            let n_both = n * (rows[{i}].both + (x * x + y * y));
            let n_squares = n * (rows[{i}].squares + e * e);
            #repeat r SSIM_TURN
            {
                let w = WINDOW_PADDED[{i} + WINDOW_PAD - {r}];
                norm.r{r} += w * n;
                sum_e.r{r} += w * n_e;
                sum_y.r{r} += w * n_y;
                sum_both.r{r} += w * n_both;
                sum_squares.r{r} += w * n_squares;
            }
            #end
        }
        #end
        #repeat r SSIM_TURN
        if (top + {r}u < view.size.y) {
            let y = top + {r}u;
            let raw = texels(i32(at.x4), y);
            let weight = weights(raw, i32(at.x4));
            var inv_norm = vec4f(1.0);
            if (loss.masked != 0u) {
                inv_norm = select(vec4f(0.0), 1.0 / norm.r{r}, weight > vec4f(0.0));
            }
            let off_e = sum_e.r{r} * inv_norm;
            let off_y = sum_y.r{r} * inv_norm;
            let off_x = off_e + off_y;
            let mu_e = about.e + off_e;
            let mu_y = about.y + off_y;
            let var_both = max(sum_both.r{r} * inv_norm - (off_x * off_x + off_y * off_y), vec4f(0.0));
            let var_e = max(sum_squares.r{r} * inv_norm - off_e * off_e, vec4f(0.0));
            let residual = residual_of(raw, i32(at.x4), y, at.channel);
            let w = windows(mu_e, mu_y, var_both, var_e, weight, inv_norm, residual);
            sum += weight * w.ssim;
            let base = 3u * at.channel;
            derivatives[plane_index(view, base, at.x4, y)] = w.own;
            derivatives[plane_index(view, base + 1u, at.x4, y)] = w.d_e;
            derivatives[plane_index(view, base + 2u, at.x4, y)] = w.d_y;
        }
        #end
    }
    let index = thread_index(thread);
    partials[index] = vec2f((sum.x + sum.y) + (sum.z + sum.w), 0.0);
}

// What four windows side by side give to the pixels in them, the first with e less `residual`.
struct Given {
    own: vec4f,
    d_e: vec4f,
    d_y: vec4f,
    residual: f32,
}

// Beside the image nothing is.
fn given_at(channel: u32, x4: i32, row: u32) -> Given {
    var given: Given;
    if (x4 >= 0 && x4 < i32(view.row_vectors)) {
        given.own = derivatives[plane_index(view, 3u * channel, u32(x4), row)];
        given.d_e = derivatives[plane_index(view, 3u * channel + 1u, u32(x4), row)];
        given.d_y = derivatives[plane_index(view, 3u * channel + 2u, u32(x4), row)];
        given.residual = residual_of(texels(x4, row), x4, row, channel);
    }
    return given;
}

@compute @workgroup_size(WORKGROUP)
fn ssim_horizontal_backward(thread: Thread) {
    let at = place(thread_index(thread), SSIM_ACROSS, 1u);
    if (!at.inside || at.y >= view.size.y) {
        return;
    }
    var row: array<Given, 5>;
    var next = i32(at.x4) - 2;
    // bound: SSIM_ACROSS turns.
    for (var x4 = at.x4; x4 < end_across(at.x4); x4++) {
        // bound: 5 turns, later 1.
        for (; next < i32(x4) + 3; next++) {
            #repeat b 4
            row[{b}] = row[{b} + 1];
            #end
            row[4] = given_at(at.channel, next, at.y);
        }
        // From each window's residual to that of the pixels which take from it.
        var own: Strip;
        #repeat b 5
        own.v{b} = row[{b}].own + row[{b}].d_e * (row[2].residual - row[{b}].residual);
        #end
        let plane = 3u * at.channel;
        moments[plane_index(view, plane, x4, at.y)] = convolve(own);
        moments[plane_index(view, plane + 1u, x4, at.y)] = convolve(Strip(row[0].d_e, row[1].d_e, row[2].d_e, row[3].d_e, row[4].d_e));
        moments[plane_index(view, plane + 2u, x4, at.y)] = convolve(Strip(row[0].d_y, row[1].d_y, row[2].d_y, row[3].d_y, row[4].d_y));
    }
}

// What the horizontal pass back has of a row: sums of what four pixels side by side take from windows, the first with e less
// `residual`, that of four pixels of the row; whether any of these counts.
struct RowDerivatives {
    own: vec4f,
    d_e: vec4f,
    d_y: vec4f,
    residual: f32,
    counts: bool,
}

// Beside the image all is 0.
fn row_derivatives_at(channel: u32, x4: u32, row: i32) -> RowDerivatives {
    var of_row: RowDerivatives;
    if (is_row(row)) {
        let y = u32(row);
        let raw = texels(i32(x4), y);
        of_row.own = moments[plane_index(view, 3u * channel, x4, y)];
        of_row.d_e = moments[plane_index(view, 3u * channel + 1u, x4, y)];
        of_row.d_y = moments[plane_index(view, 3u * channel + 2u, x4, y)];
        of_row.residual = residual_of(raw, i32(x4), y, channel);
        of_row.counts = any(weights(raw, i32(x4)) > vec4f(0.0));
    }
    return of_row;
}

@compute @workgroup_size(WORKGROUP)
fn ssim_vertical_backward(thread: Thread) {
    let at = place(thread_index(thread), 1u, SSIM_ROWS);
    if (!at.inside) {
        return;
    }
    var rows: array<RowDerivatives, SSIM_RING>;
    // The next row to be read.
    var next = i32(at.y) - REACH;
    var sum = vec4f(0.0);
    // bound: SSIM_ROWS / SSIM_TURN turns.
    for (var top = at.y; top < end_of_strip(at.y); top += SSIM_TURN) {
        // bound: SSIM_RING / SSIM_TURN turns, later 1.
        for (; next < i32(top + SSIM_TURN) + REACH; next += i32(SSIM_TURN)) {
            #repeat i LOSS_MARGIN
            rows[{i}] = rows[{i} + SSIM_TURN];
            #end
            #repeat i SSIM_TURN
            rows[{i} + LOSS_MARGIN] = row_derivatives_at(at.channel, at.x4, next + {i});
            #end
        }
        // That of the second row of the turn, if it has a pixel that counts, else of the first.
        let first_residual = select(0.0, rows[REACH].residual, rows[REACH].counts);
        let residual = select(first_residual, rows[REACH + 1].residual, rows[REACH + 1].counts);
        var own: Rows;
        var d_e: Rows;
        var d_y: Rows;
        #repeat i SSIM_RING
        {
            let row_own = rows[{i}].own + rows[{i}].d_e * (residual - rows[{i}].residual);
            #repeat r SSIM_TURN
            {
                let w = WINDOW_PADDED[{i} + WINDOW_PAD - {r}];
                own.r{r} += w * row_own;
                d_e.r{r} += w * rows[{i}].d_e;
                d_y.r{r} += w * rows[{i}].d_y;
            }
            #end
        }
        #end
        #repeat r SSIM_TURN
        {
            let y = top + {r}u;
            // Planes lie elsewhere for a view of another size, so what one has left here may be another's gradient. Without a
            // silhouette the loss does not depend on the coverage.
            var gradient = vec4f(0.0);
            var of_coverage = vec4f(0.0);
            if (y < view.size.y) {
                let raw = texels(i32(at.x4), y);
                let weight = weights(raw, i32(at.x4));
                let goal = channel_of(raw, at.channel);
                let e = rendered[plane_index(view, at.channel, at.x4, y)] - goal;
                let difference = weight * e;
                sum += abs(difference);
                let d_ssim = weight * (own.r{r} + (e - residual) * d_e.r{r} + goal * d_y.r{r});
                gradient = d_ssim + loss.l1_scale * (weight * sign(difference));
                if (loss.far_scale > 0.0) {
                    gradient += far_gradient(raw, e);
                }
                if (at.channel == 0u && loss.silhouette_scale > 0.0) {
                    of_coverage = silhouette_gradient(raw, at.x4, rendered[plane_index(view, 3u, at.x4, y)]);
                }
            }
            d_rendered[plane_index(view, at.channel, at.x4, y)] = gradient;
            if (at.channel == 0u) {
                d_rendered[plane_index(view, 3u, at.x4, y)] = of_coverage;
            }
        }
        #end
    }
    let index = thread_index(thread);
    partials[index].y = (sum.x + sum.y) + (sum.z + sum.w);
}
