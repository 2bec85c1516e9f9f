#import shared/view
#import shared/double

// A Gaussian's geometry. `geometry` holds it in three planes of `stride` vectors each.
struct Gaussian {
    // Plane 0.
    mean: vec3f,
    opacity_logit: f32,
    // Plane 1. The density guides dropout alone.
    scale_log: vec3f,
    density: f32,
    // Plane 2; not normalised.
    rotation_wxyz: vec4f,
}

// Gaussian `id`; needs `view` and `geometry`.
fn gaussian(id: u32) -> Gaussian {
    let plane_0 = geometry[id];
    let plane_1 = geometry[view.stride + id];
    let plane_2 = geometry[2u * view.stride + id];
    return Gaussian(plane_0.xyz, plane_0.w, plane_1.xyz, plane_1.w, plane_2);
}

fn is_finite(x: f32) -> bool {
    // A comparison could be folded away where the compiler assumes that no NaN occurs.
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn sigmoid(x: f32) -> f32 {
    return 1.0 / (1.0 + exp(-x));
}

// Columns of the rotation of a unit quaternion (w, x, y, z).
fn rotation_matrix(q: vec4f) -> mat3x3f {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return mat3x3f(
        vec3f(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        vec3f(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        vec3f(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
}

// The gradient to a quaternion (w, x, y, z) as stored, from that to the columns of its rotation.
fn rotation_gradient(rotation_wxyz: vec4f, r_0: vec3f, r_1: vec3f, r_2: vec3f) -> vec4f {
    let norm = length(rotation_wxyz);
    let q = rotation_wxyz / norm;
    let d_q = 2.0 * vec4f(
        q.y * (r_1.z - r_2.y) + q.z * (r_2.x - r_0.z) + q.w * (r_0.y - r_1.x),
        q.x * (r_1.z - r_2.y) - 2.0 * q.y * (r_1.y + r_2.z) + q.z * (r_0.y + r_1.x) + q.w * (r_0.z + r_2.x),
        q.x * (r_2.x - r_0.z) + q.y * (r_0.y + r_1.x) - 2.0 * q.z * (r_0.x + r_2.z) + q.w * (r_1.z + r_2.y),
        q.x * (r_0.y - r_1.x) + q.y * (r_0.z + r_2.x) + q.z * (r_1.z + r_2.y) - 2.0 * q.w * (r_0.x + r_1.y),
    );
    return (d_q - q * dot(q, d_q)) / norm;
}

// What projection and its backward share: the Gaussian in the camera and M = J W R S (2x3), with
// cov2d = M M^T + DILATION I.
struct Projection {
    p: Double,
    // x/z and y/z, and the same after the bounds of the Jacobian; z is nothing.
    ratio: Double,
    ratio_bounded: Double,
    rotation: mat3x3f,
    scale: vec3f,
    // Rows of J W.
    t_x: vec3f,
    t_y: vec3f,
    // Rows of M.
    m_x: vec3f,
    m_y: vec3f,
}

// One number of each of the three rows of [R | t].
fn column(view: View, i: u32) -> Double {
    return Double(
        vec3f(view.w2c_x[i], view.w2c_y[i], view.w2c_z[i]),
        vec3f(view.w2c_low_x[i], view.w2c_low_y[i], view.w2c_low_z[i]),
    );
}

// `mean` in the camera's axes, R mean + t. To any degree its terms may cancel: beside the camera all
// do, and where a narrow view looks from afar those across.
fn to_camera(view: View, mean: vec3f) -> Double {
    let x = product(column(view, 0u), double(mean.xxx));
    let y = product(column(view, 1u), double(mean.yyy));
    let z = product(column(view, 2u), double(mean.zzz));
    return sum(sum(sum(x, y), z), column(view, 3u));
}

fn project_gaussian(view: View, g: Gaussian) -> Projection {
    var o: Projection;
    o.p = to_camera(view, g.mean);
    o.ratio = quotient(o.p, third(o.p));
    let least = vec3f(view.ratio_min, 0.0);
    let most = vec3f(view.ratio_max, 2.0);
    let low = select(o.ratio.lo, vec3f(view.ratio_min_low, 0.0), o.ratio.hi < least);
    o.ratio_bounded.hi = clamp(o.ratio.hi, least, most);
    o.ratio_bounded.lo = select(low, vec3f(view.ratio_max_low, 0.0), o.ratio.hi > most);
    let focal_z = view.focal / o.p.hi.z;
    o.t_x = focal_z.x * (view.w2c_x.xyz - o.ratio_bounded.hi.x * view.w2c_z.xyz);
    o.t_y = focal_z.y * (view.w2c_y.xyz - o.ratio_bounded.hi.y * view.w2c_z.xyz);
    o.rotation = rotation_matrix(g.rotation_wxyz / length(g.rotation_wxyz));
    o.scale = exp(g.scale_log);
    o.m_x = (o.t_x * o.rotation) * o.scale;
    o.m_y = (o.t_y * o.rotation) * o.scale;
    return o;
}
