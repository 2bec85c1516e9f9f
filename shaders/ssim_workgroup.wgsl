// Computes the image loss and its gradient (`shared/ssim.wgsl`) on GPUs, in two dispatches: a workgroup takes a tile of
// GROUP_TILE x GROUP_TILE pixels of one channel, four a thread. The windows' rows are summed up first, of the tile's rows and of
// five more above and below; they stay in workgroup memory, where their columns are then summed up.
//
// A window's columns are summed about its middle row's mean, which the window holds. If the row counts for nothing, the
// pixel does not, either.
#import shared/thread
#import shared/ssim

// Rows of a window above or below its middle one.
const REACH = 5u;
// Vectors of four pixels across a tile.
const ACROSS = GROUP_TILE / 4u;
const ROWS = GROUP_TILE + 2u * REACH;
const STRETCHES = ROWS * ACROSS;

// A stretch of four windows' rows has weights, means of e and y, sum of the variances of x and y, variance of e.
var<workgroup> row_norm: array<vec4f, STRETCHES>;
var<workgroup> row_e: array<vec4f, STRETCHES>;
var<workgroup> row_y: array<vec4f, STRETCHES>;
var<workgroup> row_both: array<vec4f, STRETCHES>;
var<workgroup> row_squares: array<vec4f, STRETCHES>;
// A stretch of four pixels has sums of the derivatives along the row, and the mean residual that the first is about.
var<workgroup> row_own: array<vec4f, STRETCHES>;
var<workgroup> row_d_e: array<vec4f, STRETCHES>;
var<workgroup> row_d_y: array<vec4f, STRETCHES>;
var<workgroup> row_residual: array<f32, STRETCHES>;
var<workgroup> sums: array<f32, WORKGROUP>;

// The first pixel of a workgroup's tile. `channel` is 3 or more where it has none.
struct Corner {
    x4: u32,
    y: u32,
    channel: u32,
}

fn corner(group: u32) -> Corner {
    let rows = view.plane_vectors / view.row_vectors;
    let across = (view.row_vectors + ACROSS - 1u) / ACROSS;
    let tiles = across * ((rows + GROUP_TILE - 1u) / GROUP_TILE);
    let tile = group % tiles;
    return Corner((tile % across) * ACROSS, (tile / across) * GROUP_TILE, group / tiles);
}

// Whether four pixels are of the image's rows and of the padded ones' columns.
fn is_in_image(x4: u32, y: i32) -> bool {
    return x4 < view.row_vectors && y >= 0 && y < i32(view.size.y);
}

// Means of e and y of four pixels, and whether one counts.
fn means_of(x4: i32, y: u32, channel: u32) -> vec3f {
    let raw = texels(x4, y);
    let counts = weights(raw, x4) > vec4f(0.0);
    let goal_y = channel_of(raw, channel);
    return vec3f(residual_of(raw, x4, y, channel), mean_of(goal_y, counts), f32(any(counts)));
}

// Sums up the rows of four windows, from twenty pixels.
fn sum_row(stretch: u32, x4: u32, y: u32, channel: u32) {
    let x = i32(x4);
    let about = middle(means_of(x - 1, y, channel), means_of(x, y, channel), means_of(x + 1, y, channel));
    var norm = vec4f(0.0);
    var sum_e = vec4f(0.0);
    var sum_y = vec4f(0.0);
    var both = vec4f(0.0);
    var squares = vec4f(0.0);
    #repeat b 5
    {
        let raw = texels(x + {b} - 2, y);
        let weight = weights(raw, x + {b} - 2);
        let counts = weight > vec4f(0.0);
        let beside = u32(clamp(x + {b} - 2, 0, i32(view.row_vectors) - 1));
        let goal_y = channel_of(raw, channel);
        let e = select(vec4f(0.0), rendered[plane_index(view, channel, beside, y)] - goal_y, counts) - about.x;
        let y_ = select(vec4f(0.0), goal_y, counts) - about.y;
        let m = select(weight, vec4f(1.0), vec4<bool>(loss.masked == 0u));
        let sum_of_squares = (e + y_) * (e + y_) + y_ * y_;
        #repeat i 4
        if ({b}u * 4u + {i}u >= 3u && {b}u * 4u + {i}u <= 16u) {
            // The weights of pixel 4 {b} + {i} in the windows of the middle four.
            let w = m[{i}] * vec4f(
                WINDOW_PADDED[4 * {b} + {i} + 4], WINDOW_PADDED[4 * {b} + {i} + 3],
                WINDOW_PADDED[4 * {b} + {i} + 2], WINDOW_PADDED[4 * {b} + {i} + 1],
            );
            norm += w;
            sum_e += w * e[{i}];
            sum_y += w * y_[{i}];
            both += w * sum_of_squares[{i}];
            squares += w * (e[{i}] * e[{i}]);
        }
        #end
    }
    #end
    // Without a mask the weights are the window's, whose sum is 1.
    norm = select(norm, vec4f(1.0), vec4<bool>(loss.masked == 0u));
    let inv_norm = select(vec4f(0.0), 1.0 / norm, norm > vec4f(0.0));
    let mean_e = sum_e * inv_norm;
    let mean_y = sum_y * inv_norm;
    let mean_x = mean_e + mean_y;
    row_norm[stretch] = norm;
    row_e[stretch] = about.x + mean_e;
    row_y[stretch] = about.y + mean_y;
    row_both[stretch] = both * inv_norm - (mean_x * mean_x + mean_y * mean_y);
    row_squares[stretch] = squares * inv_norm - mean_e * mean_e;
}

// Sum of `mine` over the workgroup, in a fixed order, in thread 0.
fn sum_of_all(local: u32, mine: f32) -> f32 {
    sums[local] = mine;
    // bound: 6 turns, `half` halves down to 1.
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        let other = sums[min(local + half, WORKGROUP - 1u)];
        workgroupBarrier();
        sums[local] += select(0.0, other, local < half);
    }
    return sums[local];
}

@compute @workgroup_size(WORKGROUP)
fn ssim_forward(thread: Thread) {
    let group = workgroup_index(thread);
    let at = corner(group);
    // bound: STRETCHES / WORKGROUP + 1 turns.
    for (var stretch = thread.local; stretch < STRETCHES; stretch += WORKGROUP) {
        let x4 = at.x4 + stretch % ACROSS;
        let y = i32(at.y + stretch / ACROSS) - i32(REACH);
        if (is_in_image(x4, y) && at.channel < 3u) {
            sum_row(stretch, x4, u32(y), at.channel);
        } else {
            row_norm[stretch] = select(vec4f(0.0), vec4f(1.0), vec4<bool>(loss.masked == 0u));
            row_e[stretch] = vec4f(0.0);
            row_y[stretch] = vec4f(0.0);
            row_both[stretch] = vec4f(0.0);
            row_squares[stretch] = vec4f(0.0);
        }
    }
    workgroupBarrier();
    let x4 = at.x4 + thread.local % ACROSS;
    let y = at.y + thread.local / ACROSS;
    var mine = vec4f(0.0);
    if (is_in_image(x4, i32(y)) && at.channel < 3u) {
        let about_e = row_e[thread.local + REACH * ACROSS];
        let about_y = row_y[thread.local + REACH * ACROSS];
        var norm = vec4f(0.0);
        var sum_e = vec4f(0.0);
        var sum_y = vec4f(0.0);
        var sum_both = vec4f(0.0);
        var sum_squares = vec4f(0.0);
        #repeat i SSIM_WINDOW
        {
            let stretch = thread.local + {i}u * ACROSS;
            let n = WINDOW[{i}] * row_norm[stretch];
            let e = row_e[stretch] - about_e;
            let y_ = row_y[stretch] - about_y;
            let x = e + y_;
            norm += n;
            sum_e += n * e;
            sum_y += n * y_;
            sum_both += n * (row_both[stretch] + (x * x + y_ * y_));
            sum_squares += n * (row_squares[stretch] + e * e);
        }
        #end
        let raw = texels(i32(x4), y);
        let weight = weights(raw, i32(x4));
        let masked = select(vec4f(0.0), 1.0 / norm, weight > vec4f(0.0));
        let inv_norm = select(masked, vec4f(1.0), vec4<bool>(loss.masked == 0u));
        let off_e = sum_e * inv_norm;
        let off_y = sum_y * inv_norm;
        let off_x = off_e + off_y;
        let var_both = max(sum_both * inv_norm - (off_x * off_x + off_y * off_y), vec4f(0.0));
        let var_e = max(sum_squares * inv_norm - off_e * off_e, vec4f(0.0));
        let residual = residual_of(raw, i32(x4), y, at.channel);
        let w = windows(about_e + off_e, about_y + off_y, var_both, var_e, weight, inv_norm, residual);
        mine = weight * w.ssim;
        derivatives[plane_index(view, 3u * at.channel, x4, y)] = w.own;
        derivatives[plane_index(view, 3u * at.channel + 1u, x4, y)] = w.d_e;
        derivatives[plane_index(view, 3u * at.channel + 2u, x4, y)] = w.d_y;
    }
    let sum = sum_of_all(thread.local, (mine.x + mine.y) + (mine.z + mine.w));
    if (thread.local == 0u && at.channel < 3u) {
        partials[group] = vec2f(sum, 0.0);
    }
}

// Sums up what four pixels take from the windows of a row, from twenty of them.
fn sum_row_back(stretch: u32, x4: u32, y: u32, channel: u32) {
    let residual = residual_of(texels(i32(x4), y), i32(x4), y, channel);
    var sum_own = vec4f(0.0);
    var sum_d_e = vec4f(0.0);
    var sum_d_y = vec4f(0.0);
    #repeat b 5
    {
        let x = i32(x4) + {b} - 2;
        if (x >= 0 && x < i32(view.row_vectors)) {
            let d_e = derivatives[plane_index(view, 3u * channel + 1u, u32(x), y)];
            let d_y = derivatives[plane_index(view, 3u * channel + 2u, u32(x), y)];
            // From the windows' residual to that of the pixels which take from them.
            let off = residual - residual_of(texels(x, y), x, y, channel);
            let own = derivatives[plane_index(view, 3u * channel, u32(x), y)] + d_e * off;
            #repeat i 4
            if ({b}u * 4u + {i}u >= 3u && {b}u * 4u + {i}u <= 16u) {
                let w = vec4f(
                    WINDOW_PADDED[4 * {b} + {i} + 4], WINDOW_PADDED[4 * {b} + {i} + 3],
                    WINDOW_PADDED[4 * {b} + {i} + 2], WINDOW_PADDED[4 * {b} + {i} + 1],
                );
                sum_own += w * own[{i}];
                sum_d_e += w * d_e[{i}];
                sum_d_y += w * d_y[{i}];
            }
            #end
        }
    }
    #end
    row_own[stretch] = sum_own;
    row_d_e[stretch] = sum_d_e;
    row_d_y[stretch] = sum_d_y;
    row_residual[stretch] = residual;
}

@compute @workgroup_size(WORKGROUP)
fn ssim_backward(thread: Thread) {
    let group = workgroup_index(thread);
    let at = corner(group);
    // bound: STRETCHES / WORKGROUP + 1 turns.
    for (var stretch = thread.local; stretch < STRETCHES; stretch += WORKGROUP) {
        let x4 = at.x4 + stretch % ACROSS;
        let y = i32(at.y + stretch / ACROSS) - i32(REACH);
        if (is_in_image(x4, y) && at.channel < 3u) {
            sum_row_back(stretch, x4, u32(y), at.channel);
        } else {
            row_own[stretch] = vec4f(0.0);
            row_d_e[stretch] = vec4f(0.0);
            row_d_y[stretch] = vec4f(0.0);
            row_residual[stretch] = 0.0;
        }
    }
    workgroupBarrier();
    let x4 = at.x4 + thread.local % ACROSS;
    let y = at.y + thread.local / ACROSS;
    var mine = vec4f(0.0);
    if (x4 < view.row_vectors && y < view.plane_vectors / view.row_vectors && at.channel < 3u) {
        // Beyond the image there is no gradient. Without a silhouette the loss does not depend on the coverage, either; planes
        // lie elsewhere for a view of another size, so what one has left here may be another's gradient.
        var gradient = vec4f(0.0);
        var coverage = vec4f(0.0);
        if (y < view.size.y) {
            let residual = row_residual[thread.local + REACH * ACROSS];
            var own = vec4f(0.0);
            var d_e = vec4f(0.0);
            var d_y = vec4f(0.0);
            #repeat i SSIM_WINDOW
            {
                let stretch = thread.local + {i}u * ACROSS;
                let off = residual - row_residual[stretch];
                own += WINDOW[{i}] * (row_own[stretch] + row_d_e[stretch] * off);
                d_e += WINDOW[{i}] * row_d_e[stretch];
                d_y += WINDOW[{i}] * row_d_y[stretch];
            }
            #end
            let raw = texels(i32(x4), y);
            let weight = weights(raw, i32(x4));
            let x = rendered[plane_index(view, at.channel, x4, y)];
            let goal_y = channel_of(raw, at.channel);
            let difference = weight * (x - goal_y);
            mine = abs(difference);
            gradient = weight * (own + ((x - goal_y) - residual) * d_e + goal_y * d_y)
                + loss.l1_scale * (weight * sign(difference));
            if (loss.far_scale > 0.0) {
                gradient += far_gradient(raw, x - goal_y);
            }
            if (loss.silhouette_scale > 0.0) {
                coverage = silhouette_gradient(raw, x4, rendered[plane_index(view, 3u, x4, y)]);
            }
        }
        d_rendered[plane_index(view, at.channel, x4, y)] = gradient;
        if (at.channel == 0u) {
            d_rendered[plane_index(view, 3u, x4, y)] = coverage;
        }
    }
    let sum = sum_of_all(thread.local, (mine.x + mine.y) + (mine.z + mine.w));
    if (thread.local == 0u && at.channel < 3u) {
        partials[group].y = sum;
    }
}
