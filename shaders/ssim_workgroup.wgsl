// Computes the image loss and its gradient (`shared/ssim_windows.wgsl`) on GPUs, in one dispatch. A workgroup marches down a
// strip of one channel, four rows a turn, a thread a column. What windows reach back to stays in the threads' registers, so that
// nothing but the gradient is written to memory.
//
// A turn has four parts, with a barrier behind each:
//   sum_columns: a thread sums up the columns of four windows, of the last 14 pixels of its column;
//   sum_rows: it sums these sums up along a row, for four windows side by side, and finds what the gradient takes from them;
//   sum_rows_back: it sums up what four pixels side by side take from the windows of a row;
//   add_columns_back: it adds this up for the last 14 pixels of its column, of which the oldest four are done.
//
// Windows lie five rows behind the pixels that are read, and the pixels that are done five rows behind the windows. The strip's
// outer columns serve the windows of others: neighbours overlap by 20 columns, and parts of a strip by as many rows.
#import shared/thread
#import shared/ssim_windows

// Pixels one by one, where other kernels have vectors of four.
@group(0) @binding(2) var<storage, read> rendered: array<f32>;
@group(0) @binding(3) var<storage, read> goal: array<u32>;
@group(0) @binding(6) var<storage, read_write> d_rendered: array<f32>;
// The sums of SSIM and of |x - y| of each workgroup.
@group(0) @binding(7) var<storage, read_write> partials: array<vec2f>;

// Pixels of a window before or behind its middle one.
const REACH = LOSS_MARGIN / 2u;
// Stretches of four columns. Windows do not reach beyond the strip in the inner ones, all but the first and the last.
const ACROSS = LOSS_GROUP / 4u;
const INNER = ACROSS - 2u;
const STRETCHES = LOSS_TURN * ACROSS;
const INNER_STRETCHES = LOSS_TURN * INNER;

// What a turn's parts hand on; an entry is a stretch of a row. Columns of windows have weights, means of e and y, sum of the
// variances of x and y, variance of e. Later the last three hold what a row's pixels take from windows.
var<workgroup> column_norm: array<array<f32, 4>, STRETCHES>;
var<workgroup> column_e: array<array<f32, 4>, STRETCHES>;
var<workgroup> column_y: array<array<f32, 4>, STRETCHES>;
var<workgroup> column_both: array<array<f32, 4>, STRETCHES>;
var<workgroup> column_squares: array<array<f32, 4>, STRETCHES>;
// Windows have the derivatives of `Windows`. Before, the first holds the weight of the pixel in their middle.
var<workgroup> window_own: array<array<f32, 4>, INNER_STRETCHES>;
var<workgroup> window_d_e: array<array<f32, 4>, INNER_STRETCHES>;
var<workgroup> window_d_y: array<array<f32, 4>, INNER_STRETCHES>;
// The residual that the first is about, one for two stretches: there is no room for more.
var<workgroup> window_residual: array<f32, INNER_STRETCHES / 2u>;

// The last pixels of the thread's column, the newest last: residuals, texels as `read_rows` packs them, and SSIM's gradients, as
// far as their windows have been summed up.
var<private> ring_e: array<f32, LOSS_RING>;
var<private> ring_texel: array<u32, LOSS_RING>;
var<private> ring_gradient: array<f32, LOSS_RING>;
// The pixels of the next turn, on their way.
var<private> next_x: array<f32, LOSS_TURN>;
var<private> next_texel: array<u32, LOSS_TURN>;
var<private> sum_ssim: f32;
var<private> sum_l1: f32;
// Whether pixels have weights: a constant of the entry point, because a sixth of the work is theirs.
var<private> is_masked: bool;

// A workgroup's part of a strip: LOSS_GROUP columns from `x` on, of which the first and the last LOSS_MARGIN are others', and rows
// from `y` up to `end`, all in the padded image.
struct Strip {
    x: i32,
    y: i32,
    end: i32,
    channel: u32,
}

fn strip_of(group: u32) -> Strip {
    let rows = view.plane_vectors / view.row_vectors;
    let across = (4u * view.row_vectors + LOSS_STRIP - 1u) / LOSS_STRIP;
    // Channels lie side by side: they share the target image.
    let at = group / 3u;
    let y = min((at / across) * LOSS_ROWS, rows);
    let x = i32((at % across) * LOSS_STRIP) - i32(LOSS_MARGIN);
    return Strip(x, i32(y), i32(min(y + LOSS_ROWS, rows)), group % 3u);
}

// Whether a column is the strip's own.
fn is_own(column: u32) -> bool {
    return column >= LOSS_MARGIN && column < LOSS_MARGIN + LOSS_STRIP;
}

fn is_inner(stretch: u32) -> bool {
    return stretch > 0u && stretch <= INNER;
}

// The entry of an inner stretch among those of windows.
fn inner(row: u32, stretch: u32) -> u32 {
    return row * INNER + stretch - 1u;
}

// The entry of a pixel in a plane of `rendered`.
fn entry(plane: u32, x: u32, y: u32) -> u32 {
    return (plane * view.plane_vectors + y * view.row_vectors) * 4u + x;
}

// The bytes of a packed texel are the channel's value, the weight in windows, that of the pixel itself, and alpha.
fn value_of(texel: u32) -> f32 {
    return f32(texel & 255u) * (1.0 / LEVEL_MAX);
}

// A product, unlike a quotient, is exactly 1 for 255 on every driver.
fn weight_of(texel: u32) -> f32 {
    return select(1.0, f32((texel >> 8u) & 255u) * (1.0 / LEVEL_MAX), is_masked);
}

fn own_weight_of(texel: u32) -> f32 {
    return f32((texel >> 16u) & 255u) * (1.0 / LEVEL_MAX);
}

fn four(v: array<f32, 4>) -> vec4f {
    return vec4f(v[0], v[1], v[2], v[3]);
}

// The weights of four columns of windows.
fn norms(stretch: u32) -> vec4f {
    return select(vec4f(1.0), four(column_norm[stretch]), vec4<bool>(is_masked));
}

// Reads the pixels of four rows of a column, from row `y` on.
fn read_rows(strip: Strip, x: i32, y: i32) {
    let is_in_row = x >= 0 && x < i32(view.size.x);
    let all = select(255u, 0u, is_masked);
    // A pixel of the rim stands in for those beside the image: loads without branches run side by side.
    let column = u32(clamp(x, 0, i32(view.size.x) - 1));
    #repeat k LOSS_TURN
    {
        let is_inside = is_in_row && y + {k} >= 0 && y + {k} < i32(view.size.y);
        let row = u32(clamp(y + {k}, 0, i32(view.size.y) - 1));
        let texel = goal[entry(0u, column, row)];
        // Without a mask all weigh the same. So do zeros beside the image in windows, but not by themselves.
        let alpha = texel >> 24u;
        let weight = max(alpha, all);
        let value = select(0u, (texel >> (8u * strip.channel)) & 255u, weight > 0u);
        next_texel[{k}] = select(all << 8u, value | (weight << 8u) | (weight << 16u) | (alpha << 24u), is_inside);
        next_x[{k}] = rendered[entry(strip.channel, column, row)];
    }
    #end
}

// Moves the ring by four rows, and puts those that were read behind them.
fn shift() {
    #repeat i LOSS_MARGIN
    ring_e[{i}] = ring_e[{i}u + LOSS_TURN];
    ring_texel[{i}] = ring_texel[{i}u + LOSS_TURN];
    ring_gradient[{i}] = ring_gradient[{i}u + LOSS_TURN];
    #end
    #repeat k LOSS_TURN
    ring_texel[{k}u + LOSS_MARGIN] = next_texel[{k}];
    ring_gradient[{k}u + LOSS_MARGIN] = 0.0;
    // What does not count has no residual.
    ring_e[{k}u + LOSS_MARGIN] = select(0.0, next_x[{k}] - value_of(next_texel[{k}]), own_weight_of(next_texel[{k}]) > 0.0);
    #end
}

// Weight, times e, y and 1, of a pixel in the ring.
fn of_ring(e: f32, texel: u32) -> vec3f {
    return weight_of(texel) * vec3f(e, value_of(texel), 1.0);
}

// Means of e and y in the middle of the ring, which all windows hold or, where nothing counts there, in the rest.
fn middle() -> vec2f {
    var sum = vec3f(0.0);
    #repeat k LOSS_TURN
    sum += of_ring(ring_e[{k}u + REACH], ring_texel[{k}u + REACH]);
    #end
    if (sum.z == 0.0) {
        #repeat k 5
        sum += of_ring(ring_e[{k}], ring_texel[{k}]) + of_ring(ring_e[{k}u + REACH + LOSS_TURN], ring_texel[{k}u + REACH + LOSS_TURN]);
        #end
    }
    return select(vec2f(0.0), sum.xy / sum.z, sum.z > 0.0);
}

// Sums up the columns of four windows.
fn sum_columns(local: u32) {
    let about = middle();
    var norm = vec4f(0.0);
    var sum_e = vec4f(0.0);
    var sum_y = vec4f(0.0);
    var both = vec4f(0.0);
    var squares = vec4f(0.0);
    #repeat i LOSS_RING
    {
        let e = ring_e[{i}] - about.x;
        let y = value_of(ring_texel[{i}]) - about.y;
        let x = e + y;
        // The weights of row {i} in the four windows.
        let w = weight_of(ring_texel[{i}]) * vec4f(
            WINDOW_PADDED[WINDOW_PAD + {i}u], WINDOW_PADDED[WINDOW_PAD + {i}u - 1u],
            WINDOW_PADDED[WINDOW_PAD + {i}u - 2u], WINDOW_PADDED[WINDOW_PAD + {i}u - 3u],
        );
        norm += w;
        sum_e += w * e;
        sum_y += w * y;
        both += w * (x * x + y * y);
        squares += w * (e * e);
    }
    #end
    let inv_norm = select(vec4f(0.0), 1.0 / norm, norm > vec4f(0.0));
    let mean_e = sum_e * inv_norm;
    let mean_y = sum_y * inv_norm;
    let mean_x = mean_e + mean_y;
    both = both * inv_norm - (mean_x * mean_x + mean_y * mean_y);
    squares = squares * inv_norm - mean_e * mean_e;
    let stretch = local / 4u;
    let lane = local % 4u;
    #repeat k LOSS_TURN
    if (is_masked) {
        column_norm[{k}u * ACROSS + stretch][lane] = norm[{k}];
    }
    column_e[{k}u * ACROSS + stretch][lane] = about.x + mean_e[{k}];
    column_y[{k}u * ACROSS + stretch][lane] = about.y + mean_y[{k}];
    column_both[{k}u * ACROSS + stretch][lane] = both[{k}];
    column_squares[{k}u * ACROSS + stretch][lane] = squares[{k}];
    #end
    if (is_inner(stretch)) {
        #repeat k LOSS_TURN
        window_own[inner({k}u, stretch)][lane] = own_weight_of(ring_texel[{k}u + REACH]);
        #end
    }
}

// Sums up the rows of four windows, about a mean in their middle. SSIM counts where the row is the workgroup's own.
fn sum_rows(row: u32, stretch: u32, is_own_row: bool) {
    let inner = inner(row, stretch);
    let own = row * ACROSS + stretch;
    let middle_norm = norms(own);
    let middle_e = dot(middle_norm, four(column_e[own]));
    let weight_here = dot(middle_norm, vec4f(1.0));
    let inv_middle = select(0.0, 1.0 / weight_here, weight_here > 0.0);
    let about = inv_middle * vec2f(middle_e, dot(middle_norm, four(column_y[own])));
    // Both stretches of a pair find the same mean residual.
    let beside = row * ACROSS + 1u + ((stretch - 1u) ^ 1u);
    let beside_norm = norms(beside);
    let pair_norm = weight_here + dot(beside_norm, vec4f(1.0));
    let pair_e = middle_e + dot(beside_norm, four(column_e[beside]));
    let pair_residual = select(0.0, pair_e / pair_norm, pair_norm > 0.0);
    var norm = vec4f(0.0);
    var sum_e = vec4f(0.0);
    var sum_y = vec4f(0.0);
    var sum_both = vec4f(0.0);
    var sum_squares = vec4f(0.0);
    #repeat b 5
    {
        // What lies beside the strip is in no window that counts.
        let at = row * ACROSS + clamp(stretch + {b}u, 2u, ACROSS + 1u) - 2u;
        let n = norms(at);
        let e = four(column_e[at]) - about.x;
        let y = four(column_y[at]) - about.y;
        let x = e + y;
        let both = four(column_both[at]) + (x * x + y * y);
        let squares = four(column_squares[at]) + e * e;
        #repeat i 4
        if ({b}u * 4u + {i}u >= 3u && {b}u * 4u + {i}u <= 16u) {
            // The weights of column 4 {b} + {i} in the middle four windows.
            let w = n[{i}] * vec4f(
                WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 3u], WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 4u],
                WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 5u], WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 6u],
            );
            norm += w;
            sum_e += w * e[{i}];
            sum_y += w * y[{i}];
            sum_both += w * both[{i}];
            sum_squares += w * squares[{i}];
        }
        #end
    }
    #end
    let weight = four(window_own[inner]);
    let inv_norm = select(vec4f(0.0), 1.0 / norm, weight > vec4f(0.0));
    let off_e = sum_e * inv_norm;
    let off_y = sum_y * inv_norm;
    let off_x = off_e + off_y;
    let var_both = max(sum_both * inv_norm - (off_x * off_x + off_y * off_y), vec4f(0.0));
    let var_e = max(sum_squares * inv_norm - off_e * off_e, vec4f(0.0));
    let w = windows(about.x + off_e, about.y + off_y, var_both, var_e, weight, inv_norm, pair_residual);
    #repeat i 4
    window_own[inner][{i}] = w.own[{i}];
    window_d_e[inner][{i}] = w.d_e[{i}];
    window_d_y[inner][{i}] = w.d_y[{i}];
    #end
    if (stretch % 2u == 1u) {
        window_residual[inner / 2u] = pair_residual;
    }
    #repeat i 4
    sum_ssim += select(0.0, weight[{i}] * w.ssim[{i}], is_own_row && is_own(4u * stretch + {i}u));
    #end
}

// Sums up what four pixels take from the windows of a row.
fn sum_rows_back(row: u32, stretch: u32) {
    let about = window_residual[inner(row, stretch) / 2u];
    var sum_own = vec4f(0.0);
    var sum_d_e = vec4f(0.0);
    var sum_d_y = vec4f(0.0);
    #repeat b 5
    {
        // The strip's own pixels take nothing from beside the inner stretches.
        let at = row * INNER + clamp(stretch + {b}u, 3u, INNER + 2u) - 3u;
        let d_e = four(window_d_e[at]);
        let d_y = four(window_d_y[at]);
        // From the windows' residual to that of the pixels which take from them.
        let own = four(window_own[at]) + d_e * (about - window_residual[at / 2u]);
        #repeat i 4
        if ({b}u * 4u + {i}u >= 3u && {b}u * 4u + {i}u <= 16u) {
            let w = vec4f(
                WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 3u], WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 4u],
                WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 5u], WINDOW_PADDED[WINDOW_PAD + {b}u * 4u + {i}u - 6u],
            );
            sum_own += w * own[{i}];
            sum_d_e += w * d_e[{i}];
            sum_d_y += w * d_y[{i}];
        }
        #end
    }
    #end
    let to = row * ACROSS + stretch;
    #repeat i 4
    column_y[to][{i}] = sum_own[{i}];
    column_both[to][{i}] = sum_d_e[{i}];
    column_squares[to][{i}] = sum_d_y[{i}];
    #end
}

// Adds what the pixels of the thread's column take from four rows of windows to their gradients.
fn add_columns_back(local: u32) {
    let stretch = local / 4u;
    let lane = local % 4u;
    // All is about the column's mean residual in a window.
    let residual = column_e[ACROSS + stretch][lane];
    var own: vec4f;
    var d_e: vec4f;
    var d_y: vec4f;
    #repeat k LOSS_TURN
    {
        let at = {k}u * ACROSS + stretch;
        let about = window_residual[inner({k}u, clamp(stretch, 1u, INNER)) / 2u];
        d_e[{k}] = column_both[at][lane];
        d_y[{k}] = column_squares[at][lane] * (1.0 / (16777216.0 * LEVEL_MAX));
        own[{k}] = column_y[at][lane] + d_e[{k}] * (residual - about);
    }
    #end
    #repeat i LOSS_RING
    {
        let e = ring_e[{i}] - residual;
        // The value times 2^24 and 255: a driver that found it in `sum_columns` would keep it for all rows in registers.
        let y = f32(ring_texel[{i}] << 24u);
        let w = vec4f(
            WINDOW_PADDED[WINDOW_PAD + {i}u], WINDOW_PADDED[WINDOW_PAD + {i}u - 1u],
            WINDOW_PADDED[WINDOW_PAD + {i}u - 2u], WINDOW_PADDED[WINDOW_PAD + {i}u - 3u],
        );
        let taken = own + e * d_e + y * d_y;
        #repeat k LOSS_TURN
        ring_gradient[{i}] += w[{k}] * taken[{k}];
        #end
    }
    #end
}

// Writes the gradient of four pixels of a column, from row `first` on.
fn finish(strip: Strip, x: u32, first: i32) {
    #repeat k LOSS_TURN
    if (first + {k} >= strip.y && first + {k} < strip.end) {
        let texel = ring_texel[{k}];
        let e = ring_e[{k}];
        let difference = own_weight_of(texel) * e;
        sum_l1 += abs(difference);
        // Beyond the image there is no gradient, and no weight.
        var gradient = own_weight_of(texel) * (ring_gradient[{k}] + loss.l1_scale * sign(difference));
        if (loss.far_scale > 0.0) {
            gradient += far_gradient(vec4u(texel), vec4f(e)).x;
        }
        d_rendered[entry(strip.channel, x, u32(first + {k}))] = gradient;
    }
    #end
    if (strip.channel == 0u) {
        finish_coverage(strip, x, first);
    }
}

// Writes the coverage's gradient of four pixels. Without a silhouette the loss does not depend on it; planes lie elsewhere for
// a view of another size, so what one has left here may be another's gradient.
fn finish_coverage(strip: Strip, x: u32, first: i32) {
    #repeat k LOSS_TURN
    if (first + {k} >= strip.y && first + {k} < strip.end) {
        let y = u32(first + {k});
        var gradient = 0.0;
        if (loss.silhouette_scale > 0.0 && x < view.size.x && y < view.size.y) {
            gradient = silhouette_of(vec4u(ring_texel[{k}]), vec4f(rendered[entry(3u, x, y)])).x;
        }
        d_rendered[entry(3u, x, y)] = gradient;
    }
    #end
}

// Writes the sums of SSIM and |x - y| over the workgroup, added up in a fixed order.
fn sum_up(local: u32, group: u32) {
    column_e[local] = array<f32, 4>(sum_ssim, sum_l1, 0.0, 0.0);
    // bound: 7 turns, `half` halves down to 1.
    for (var half = LOSS_GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (local < half) {
            column_e[local][0] += column_e[local + half][0];
            column_e[local][1] += column_e[local + half][1];
        }
    }
    if (local == 0u) {
        partials[group] = vec2f(column_e[0][0], column_e[0][1]);
    }
}

@compute @workgroup_size(LOSS_GROUP)
fn ssim_march(thread: Thread) {
    march(thread);
}

@compute @workgroup_size(LOSS_GROUP)
fn ssim_march_masked(thread: Thread) {
    is_masked = true;
    march(thread);
}

fn march(thread: Thread) {
    let group = workgroup_index(thread);
    let strip = strip_of(group);
    let local = thread.local;
    let x = strip.x + i32(local);
    let row = local / ACROSS;
    let stretch = local % ACROSS;
    // The rows above the first turn's, two of them for nothing.
    #repeat t 3
    read_rows(strip, x, strip.y - 12 + 4 * {t});
    shift();
    #end
    read_rows(strip, x, strip.y);
    // bound: (LOSS_ROWS + LOSS_MARGIN) / LOSS_TURN + 1 turns.
    for (var y = strip.y; y < strip.end + i32(LOSS_MARGIN); y += i32(LOSS_TURN)) {
        shift();
        sum_columns(local);
        workgroupBarrier();
        if (is_inner(stretch)) {
            let at = y - i32(REACH) + i32(row);
            sum_rows(row, stretch, at >= strip.y && at < strip.end);
        }
        workgroupBarrier();
        // The strip's own pixels lie within these.
        if (stretch >= 2u && stretch < INNER) {
            sum_rows_back(row, stretch);
        }
        workgroupBarrier();
        add_columns_back(local);
        workgroupBarrier();
        read_rows(strip, x, y + i32(LOSS_TURN));
        // In the first two turns nothing of its own is done.
        if (y >= strip.y + i32(LOSS_MARGIN) - i32(LOSS_TURN) && is_own(local) && u32(x) < 4u * view.row_vectors) {
            finish(strip, u32(x), y - i32(LOSS_MARGIN));
        }
    }
    if (strip.y < strip.end) {
        sum_up(local, group);
    }
}
