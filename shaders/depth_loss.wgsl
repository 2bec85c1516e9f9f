// Compares rendered depths and normals with targets, and puts the gradient in their place.
//
// Moments are taken about their means and merged pairwise (Chan et al. 1983), in a fixed order: each row
// of a patch, each patch, the image. Means have twice the digits of f32: gradients are divided by a deviation that may be
// a thousandth of the mean, and thousands of roundings of the mean would show. Pixels count that less than half of the
// light passes through, by the weight of their target.
#import shared/thread
#import shared/double

// What is compared, and how. 32 bytes.
struct DepthLoss {
    // Weights of the loss over the image, of that over patches, and of the normals'.
    weight: f32,
    patch_weight: f32,
    normal_weight: f32,
    // LOSS_*.
    kind: u32,
    // DEPTH_SUM, DEPTH_MEDIAN or DEPTH_MODE.
    plane: u32,
    // 1: inverse depths are compared.
    inverse: u32,
    // Width of a patch, in vectors; it is as high as wide.
    patch_vectors: u32,
    // 1: the target has normals.
    normals: u32,
}

// 1 - Pearson's correlation; mean L1 after the best scale and shift of the target; mean L1.
const LOSS_PEARSON = 0u;
const LOSS_SCALE_SHIFT = 1u;
const LOSS_L1 = 2u;
// Squared ratio of deviation to mean at or below which depths do not correlate with anything.
const LEAST_VARIATION = 1e-6;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> depth_loss: DepthLoss;
@group(0) @binding(2) var<storage, read_write> depths: array<vec4u>;
// Planes depth and weight and, with normals, normal times weight.
@group(0) @binding(3) var<storage, read> depth_target: array<vec4f>;
// Records of the rows of patches, of patches, and of the image.
@group(0) @binding(4) var<storage, read_write> depth_sums: array<Record>;
// Losses of the image, of the patches and of normals, without their weights; share of pixels that count.
@group(0) @binding(5) var<storage, read_write> depth_losses: array<vec4f>;

#import shared/depth

// Weight, means, and sums of products about them, of rendered depths x and targets y.
struct Moments {
    m: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    // What x and y lack.
    x_lo: f32,
    y_lo: f32,
}

struct Record {
    moments: Moments,
    // Weight of normals, and sum of their losses.
    normal: vec2f,
    // Number of patches that correlate, and sum of their losses.
    patches: vec2f,
    // With e the error of the fitted target: sum of m sign e, of m sign e (y - mean y), of m |e|.
    errors: vec3f,
}

fn merged(a: Moments, b: Moments) -> Moments {
    let m = a.m + b.m;
    let share = select(0.0, b.m / m, b.m > 0.0);
    let x = (b.x - a.x) + (b.x_lo - a.x_lo);
    let y = (b.y - a.y) + (b.y_lo - a.y_lo);
    let both = a.m * share;
    let exact = two_sum(vec3f(a.x, a.y, 0.0), vec3f(share * x, share * y, 0.0));
    let mean = renormalized(exact.hi, exact.lo + vec3f(a.x_lo, a.y_lo, 0.0));
    return Moments(
        m,
        mean.hi.x,
        mean.hi.y,
        (a.xx + b.xx) + both * x * x,
        (a.xy + b.xy) + both * x * y,
        (a.yy + b.yy) + both * y * y,
        mean.lo.x,
        mean.lo.y,
    );
}

fn joined(a: Record, b: Record) -> Record {
    return Record(
        merged(a.moments, b.moments),
        a.normal + b.normal,
        a.patches + b.patches,
        a.errors + b.errors,
    );
}

fn correlates(s: Moments) -> bool {
    return s.xx > LEAST_VARIATION * s.m * s.x * s.x && s.yy > LEAST_VARIATION * s.m * s.y * s.y;
}

fn correlation(s: Moments) -> f32 {
    return s.xy / (sqrt(s.xx) * sqrt(s.yy));
}

// Scale and shift of the target.
fn fit(s: Moments) -> vec2f {
    let scale = select(0.0, s.xy / s.yy, s.yy > LEAST_VARIATION * s.m * s.y * s.y);
    return select(vec2f(scale, s.x - scale * s.y), vec2f(1.0, 0.0), depth_loss.kind == LOSS_L1);
}

// Four pixels.
struct Seen {
    // 1 - transmittance.
    cover: vec4f,
    // As they are compared; nothing where the weight is 0.
    x: vec4f,
    y: vec4f,
    weight: vec4f,
    // Times their weight.
    normal_x: vec4f,
    normal_y: vec4f,
    normal_z: vec4f,
    normal_weight: vec4f,
}

fn seen(x4: u32, y: u32) -> Seen {
    let cover = 1.0 - depth_plane(DEPTH_TRANSMITTANCE, x4, y);
    let plane = depth_plane(depth_loss.plane, x4, y);
    let depth = select(plane, plane / cover, vec4<bool>(depth_loss.plane == DEPTH_SUM));
    let compared = select(depth, 1.0 / depth, vec4<bool>(depth_loss.inverse == 1u));
    let counts = (cover >= vec4f(0.5)) & (depth > vec4f(0.0));
    let weight = select(vec4f(0.0), depth_target[plane_index(view, 1u, x4, y)], counts);
    let is_weighed = weight > vec4f(0.0);
    // Without normals all three are another plane, weighed by 0.
    let first = 2u * depth_loss.normals;
    let has = select(vec4f(0.0), vec4f(1.0), (cover >= vec4f(0.5)) & vec4<bool>(depth_loss.normals == 1u));
    let n_x = has * depth_target[plane_index(view, first, x4, y)];
    let n_y = has * depth_target[plane_index(view, first + depth_loss.normals, x4, y)];
    let n_z = has * depth_target[plane_index(view, first + 2u * depth_loss.normals, x4, y)];
    return Seen(
        cover,
        select(vec4f(0.0), compared, is_weighed),
        select(vec4f(0.0), depth_target[plane_index(view, 0u, x4, y)], is_weighed),
        weight,
        n_x,
        n_y,
        n_z,
        sqrt(n_x * n_x + n_y * n_y + n_z * n_z),
    );
}

fn n_columns() -> u32 {
    return (view.row_vectors + depth_loss.patch_vectors - 1u) / depth_loss.patch_vectors;
}

fn n_row_records() -> u32 {
    return n_columns() * view.size.y;
}

fn n_patches() -> u32 {
    let side = 4u * depth_loss.patch_vectors;
    return n_columns() * ((view.size.y + side - 1u) / side);
}

fn image_record() -> u32 {
    return n_row_records() + n_patches();
}

// One thread a row of a patch.
@compute @workgroup_size(WORKGROUP)
fn depth_rows(thread: Thread) {
    let id = thread_index(thread);
    if (id >= n_row_records()) {
        return;
    }
    let y = id / n_columns();
    let first = (id % n_columns()) * depth_loss.patch_vectors;
    var sum: Moments;
    var normal: vec2f;
    // bound: patch_vectors turns, at most 256.
    for (var x4 = first; x4 < min(first + depth_loss.patch_vectors, view.row_vectors); x4++) {
        let s = seen(x4, y);
        let agreement = s.normal_x * depth_plane(DEPTH_NORMAL, x4, y)
            + s.normal_y * depth_plane(DEPTH_NORMAL + 1u, x4, y)
            + s.normal_z * depth_plane(DEPTH_NORMAL + 2u, x4, y);
        let of_normals = s.normal_weight - agreement;
        #repeat k 4
        sum = merged(sum, Moments(s.weight[{k}], s.x[{k}], s.y[{k}], 0.0, 0.0, 0.0, 0.0, 0.0));
        normal += vec2f(s.normal_weight[{k}], of_normals[{k}]);
        #end
    }
    depth_sums[id] = Record(sum, normal, vec2f(0.0), vec3f(0.0));
}

// One thread a patch.
@compute @workgroup_size(WORKGROUP)
fn depth_patches(thread: Thread) {
    let id = thread_index(thread);
    if (id >= n_patches()) {
        return;
    }
    let side = 4u * depth_loss.patch_vectors;
    let first = (id / n_columns()) * side;
    var sum: Record;
    // bound: 4 patch_vectors turns.
    for (var y = first; y < min(first + side, view.size.y); y++) {
        sum = joined(sum, depth_sums[y * n_columns() + id % n_columns()]);
    }
    if (correlates(sum.moments)) {
        sum.patches = vec2f(1.0, 1.0 - correlation(sum.moments));
    }
    depth_sums[n_row_records() + id] = sum;
}

var<workgroup> parts: array<Record, WORKGROUP>;

// The sum of `n` records from `first` on, in the first thread's `parts[0]`; one workgroup.
fn sum_records(local: u32, first: u32, n: u32) {
    let chunk = (n + WORKGROUP - 1u) / WORKGROUP;
    var sum: Record;
    // bound: n / WORKGROUP + 1 turns, n at most a record a row of a patch.
    for (var i = local * chunk; i < min((local + 1u) * chunk, n); i++) {
        sum = joined(sum, depth_sums[first + i]);
    }
    parts[local] = sum;
    workgroupBarrier();
    if (local == 0u) {
        // bound: WORKGROUP turns.
        for (var i = 1u; i < WORKGROUP; i++) {
            sum = joined(sum, parts[i]);
        }
        parts[0] = sum;
    }
}

fn quotient_or_0(a: f32, b: f32) -> f32 {
    return select(0.0, a / b, b > 0.0);
}

// One workgroup; the image's loss is Pearson's.
@compute @workgroup_size(WORKGROUP)
fn depth_total(thread: Thread) {
    sum_records(thread.local, n_row_records(), n_patches());
    if (workgroup_index(thread) == 0u && thread.local == 0u) {
        let sum = parts[0];
        depth_sums[image_record()] = sum;
        depth_losses[0] = vec4f(
            select(0.0, 1.0 - correlation(sum.moments), correlates(sum.moments)),
            quotient_or_0(sum.patches.y, sum.patches.x),
            quotient_or_0(sum.normal.y, sum.normal.x),
            sum.moments.m / f32(view.size.x * view.size.y),
        );
    }
}

// One thread a row of a patch: the errors of the fitted target.
@compute @workgroup_size(WORKGROUP)
fn depth_errors(thread: Thread) {
    let id = thread_index(thread);
    if (id >= n_row_records()) {
        return;
    }
    let all = depth_sums[image_record()].moments;
    let line = fit(all);
    let y = id / n_columns();
    let first = (id % n_columns()) * depth_loss.patch_vectors;
    var sum: vec3f;
    // bound: patch_vectors turns, at most 256.
    for (var x4 = first; x4 < min(first + depth_loss.patch_vectors, view.row_vectors); x4++) {
        let s = seen(x4, y);
        let error = line.x * s.y + line.y - s.x;
        #repeat k 4
        sum += s.weight[{k}] * vec3f(sign(error[{k}]), sign(error[{k}]) * ((s.y[{k}] - all.y) - all.y_lo), abs(error[{k}]));
        #end
    }
    depth_sums[id] = Record(Moments(), vec2f(0.0), vec2f(0.0), sum);
}

// One workgroup: the image's loss is that of the errors.
@compute @workgroup_size(WORKGROUP)
fn depth_errors_total(thread: Thread) {
    sum_records(thread.local, 0u, n_row_records());
    if (workgroup_index(thread) == 0u && thread.local == 0u) {
        let at = image_record();
        depth_sums[at].errors = parts[0].errors;
        depth_losses[0].x = quotient_or_0(parts[0].errors.z, depth_sums[at].moments.m);
    }
}

// The gradient of 1 - correlation with respect to rendered depths.
fn correlation_gradient(s: Moments, at: Seen) -> vec4f {
    let r = correlation(s);
    let slope = (r / s.xx) * ((at.x - s.x) - s.x_lo) - (1.0 / (sqrt(s.xx) * sqrt(s.yy))) * ((at.y - s.y) - s.y_lo);
    return select(vec4f(0.0), at.weight * slope, vec4<bool>(correlates(s)));
}

// One thread four pixels, those of the padding, too: the gradient takes the place of what it is of.
@compute @workgroup_size(WORKGROUP)
fn depth_gradient(thread: Thread) {
    let id = thread_index(thread);
    if (id >= view.plane_vectors) {
        return;
    }
    let x4 = id % view.row_vectors;
    let y = id / view.row_vectors;
    let s = seen(x4, y);
    let patch_row = min(y, view.size.y - 1u) / (4u * depth_loss.patch_vectors);
    let own = depth_sums[n_row_records() + patch_row * n_columns() + x4 / depth_loss.patch_vectors];
    let all = depth_sums[image_record()];
    let line = fit(all.moments);
    let is_fitted = depth_loss.kind == LOSS_SCALE_SHIFT;
    let slant = select(0.0, all.errors.y / all.moments.yy, is_fitted && line.x != 0.0);
    let offset = select(0.0, all.errors.x / all.moments.m, is_fitted);
    let error = line.x * s.y + line.y - s.x;
    let by_errors = s.weight * (slant * ((s.y - all.moments.y) - all.moments.y_lo) + offset - sign(error)) / all.moments.m;
    let by_image = select(
        select(vec4f(0.0), by_errors, s.weight > vec4f(0.0)),
        correlation_gradient(all.moments, s),
        vec4<bool>(depth_loss.kind == LOSS_PEARSON),
    );
    let by_patch = quotient_or_0(1.0, all.patches.x) * correlation_gradient(own.moments, s);
    let d_x = depth_loss.weight * by_image + depth_loss.patch_weight * by_patch;
    let is_inverse = vec4<bool>(depth_loss.inverse == 1u);
    // 0 where the weight is.
    let d_depth = select(d_x, -(s.x * s.x) * d_x, is_inverse);
    let depth = select(s.x, 1.0 / s.x, is_inverse & (s.x > vec4f(0.0)));
    let d_expected = select(vec4f(0.0), d_depth / s.cover, (s.weight > vec4f(0.0)) & vec4<bool>(depth_loss.plane == DEPTH_SUM));
    let d_median = select(vec4f(0.0), d_depth, vec4<bool>(depth_loss.plane == DEPTH_MEDIAN));
    let d_mode = select(vec4f(0.0), d_depth, vec4<bool>(depth_loss.plane == DEPTH_MODE));
    let by_normal = -depth_loss.normal_weight * quotient_or_0(1.0, all.normal.x);
    depths[plane_index(view, DEPTH_SUM, x4, y)] = bitcast<vec4u>(d_expected);
    depths[plane_index(view, DEPTH_NORMAL, x4, y)] = bitcast<vec4u>(by_normal * s.normal_x);
    depths[plane_index(view, DEPTH_NORMAL + 1u, x4, y)] = bitcast<vec4u>(by_normal * s.normal_y);
    depths[plane_index(view, DEPTH_NORMAL + 2u, x4, y)] = bitcast<vec4u>(by_normal * s.normal_z);
    depths[plane_index(view, DEPTH_MEDIAN, x4, y)] = bitcast<vec4u>(d_median);
    depths[plane_index(view, DEPTH_MODE, x4, y)] = bitcast<vec4u>(d_mode);
    depths[plane_index(view, DEPTH_ALPHA, x4, y)] = bitcast<vec4u>(-depth * d_expected);
}
