// Projects every Gaussian into the view, and finds the key of the depth sort: one thread a Gaussian.
#import shared/thread
#import shared/view
#import shared/splat
#import shared/entries
#import shared/double
#import shared/gaussian
#import shared/dropout
#import shared/sh

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4f>;
@group(0) @binding(2) var<storage, read> sh_0: array<vec4f>;
@group(0) @binding(3) var<storage, read> sh_2: array<vec4f>;
@group(0) @binding(4) var<storage, read> sh_3: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> splats: array<SplatVectors>;

@group(0) @binding(6) var<storage, read_write> depth_order: array<vec2u>;

const NOT_DRAWN = 0xffffffffu;
// Powers of 2 that a distance from the frame's origin may be smaller than the origin's depth, in the
// exponent's place.
const ORIGIN_RANGE = 64u << 23u;

// A number that orders as depths beyond the near plane do. Positive floats order as their bits
// do, and are dense about 0. Here they are dense about two depths: up to half that of the
// frame's origin the bits are those of the depth itself, so that what lies beside the camera is told apart;
// beyond it those of the distance from the origin's plane, so that the scene is, from however far
// away. Neither is ever the coarser choice, and below 2^32 there is room for both.
fn depth_key(z: Double) -> u32 {
    let origin = view.w2c_z.w;
    let halfway = 0.5 * origin;
    let nearest = bitcast<u32>(view.near);
    if (z.hi.z < halfway || !(halfway > view.near)) {
        return bitcast<u32>(z.hi.z) - nearest;
    }
    let distance = max((z.hi.z - origin) + z.lo.z, -halfway);
    let least = bitcast<u32>(halfway) - ORIGIN_RANGE;
    let size = max(bitcast<u32>(abs(distance)), least) - least;
    let middle = bitcast<u32>(halfway) - nearest + ORIGIN_RANGE;
    return select(middle + size, middle - size, distance < 0.0);
}

// One row of J W R, but for its focal length over z |q|^2, in twice the digits.
fn exact_row(w: Double, w_z: Double, ratio: Double, q: vec4f) -> Double {
    let row = sum(w, negated(product(ratio, w_z)));
    // R^T v |q|^2 = (w^2 - u.u) v + 2 (u.v) u - 2 w (u x v).
    let axis = double(q.yzw);
    let angle = double(q.xxx);
    let share = sum(product(angle, angle), negated(dot_product(axis, axis)));
    let along = product(dot_product(axis, row), axis);
    let across = product(angle, cross_product(axis, row));
    let turned = sum(along, negated(across));
    return sum(product(share, row), Double(2.0 * turned.hi, 2.0 * turned.lo));
}

// x of the anchor less that of the ellipse's axis in its row, r_x - cov_xy / cov_yy r_y, where
// these are the large numbers of a mean far outside the image.
fn exact_shear(g: Gaussian, o: Projection, r: Double) -> f32 {
    let w_z = Double(view.w2c_z.xyz, view.w2c_low_z.xyz);
    let t_x = exact_row(Double(view.w2c_x.xyz, view.w2c_low_x.xyz), w_z, first(o.ratio_bounded), g.rotation_wxyz);
    let t_y = exact_row(Double(view.w2c_y.xyz, view.w2c_low_y.xyz), w_z, second(o.ratio_bounded), g.rotation_wxyz);
    let focal = Double(vec3f(view.focal, 0.0), vec3f(view.focal_low, 0.0));
    // Rounded factors that both rows share change the covariance by nothing but its dilation.
    let scale = double(o.scale * (view.focal.y / (o.p.hi.z * dot(g.rotation_wxyz, g.rotation_wxyz))));
    let m_x = product(t_x, scale);
    let m_y = product(t_y, scale);
    let stretch = quotient(first(focal), second(focal));
    let cov_xy = product(stretch, dot_product(m_x, m_y));
    let cov_yy = sum(dot_product(m_y, m_y), double(vec3f(DILATION)));
    let shear = sum(first(r), negated(product(quotient(cov_xy, cov_yy), second(r))));
    return shear.hi.x;
}

@compute @workgroup_size(WORKGROUP)
fn project(thread: Thread) {
    let id = thread_index(thread);
    if (id >= view.n_gaussians) {
        return;
    }
    let stride = view.stride;
    let g = gaussian(id);
    splats[id].factor_reach = vec4f(0.0);
    depth_order[id] = stored_depth_entry(DepthEntry(NOT_DRAWN, id));
    if (is_dropped(view, id, g.mean, g.density)) {
        return;
    }

    let o = project_gaussian(view, g);
    if (!((o.p.hi.z - view.near) + o.p.lo.z > 0.0)) {
        return;
    }
    // Above 1 it widens the core in which alpha is capped.
    let opacity = sigmoid(g.opacity_logit) / kept_share(view);
    let reach = log2(LEVEL_MAX * opacity);
    if (!(reach > 0.0)) {
        return;
    }
    let a = dot(o.m_x, o.m_x);
    let c = dot(o.m_y, o.m_y);
    let b = dot(o.m_x, o.m_y);
    let cov_yy = c + DILATION;
    // Variance of x given y: det / cov_yy, with det(M M^T) as a sum of squares of minors.
    let minors = cross(o.m_x, o.m_y / sqrt(cov_yy));
    let var_x = dot(minors, minors) + DILATION * (a + c + DILATION) / cov_yy;
    let l_xx = CONIC_SCALE / sqrt(var_x);
    let l_xy = -(b / cov_yy) * l_xx;
    let l_yy = CONIC_SCALE / sqrt(cov_yy);
    let focal = Double(vec3f(view.focal, 0.0), vec3f(view.focal_low, 0.0));
    let principal = Double(vec3f(view.principal, 0.0), vec3f(view.principal_low, 0.0));
    let mean2d = sum(product(focal, o.ratio), principal);
    let anchor = clamp(floor(mean2d.hi.xy), vec2f(0.0), vec2f(view.size) - 1.0) + 0.5;
    // The anchor less the mean.
    let r = sum(double(vec3f(anchor, 0.0)), negated(mean2d));
    var shear = r.hi.x - (b / cov_yy) * r.hi.y;
    let half_size = sqrt(reach) / CONIC_SCALE * sqrt(vec2f(a, c) + DILATION);
    if (any(abs(r.hi.xy) > vec2f(1.0)) && all(abs(r.hi.xy) <= half_size + 1.0)) {
        shear = exact_shear(g, o, r);
    }
    let t_0 = vec2f(l_xx * shear, l_yy * r.hi.y);
    // One sum carries every NaN and infinity there may be.
    if (!is_finite(t_0.x + t_0.y + l_xx + l_xy + l_yy + a + c + opacity) || !(l_xx > 1e-18) || !(l_yy > 1e-18)) {
        return;
    }

    let direction = normalize(from_center(view, g.mean));
    let y = sh_basis(direction);
    let p0 = sh_0[id];
    var color = vec3f(0.5) + y.a.x * p0.xyz;
    if (SH_DEGREE >= 1u) {
        color = vec3f(0.5) + sh_sum(y.a, p0, sh_0[stride + id], sh_0[2u * stride + id]);
    }
    if (SH_DEGREE >= 2u) {
        color += sh_sum(y.b, sh_2[id], sh_2[stride + id], sh_2[2u * stride + id]);
        let p6 = sh_2[3u * stride + id];
        if (SH_DEGREE == 2u) {
            color += y.c.x * p6.xyz;
        } else {
            color += sh_sum(y.c, p6, sh_3[id], sh_3[stride + id]);
            color += sh_sum(y.d, sh_3[2u * stride + id], sh_3[3u * stride + id], sh_3[4u * stride + id]);
        }
    }
    if (!is_finite(color.x + color.y + color.z)) {
        return;
    }

    splats[id] = packed(Splat(anchor, t_0, l_xx, l_xy, l_yy, reach, max(color, vec3f(0.0)), opacity));
    depth_order[id] = stored_depth_entry(DepthEntry(depth_key(o.p), id));
}
