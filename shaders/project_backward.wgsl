// Carries gradients back through the projection: one thread a Gaussian carries the sums of sum_pairs
// through covariance, projection, SH direction and quaternion normalisation to the stored
// parameters. The step's first view writes, its second adds.
#import shared/thread
#import shared/view
#import shared/splat
#import shared/splat_gradient
#import shared/on_screen
#import shared/double
#import shared/gaussian
#import shared/sh
#import shared/sh_mean

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4f>;
@group(0) @binding(2) var<storage, read> sh_0: array<vec4f>;
@group(0) @binding(3) var<storage, read> sh_2: array<vec4f>;
@group(0) @binding(4) var<storage, read> sh_3: array<vec4f>;
// The splats' gradients.
@group(0) @binding(5) var<storage, read> splats: array<SplatVectors>;
// Planes as `geometry`.
@group(0) @binding(6) var<storage, read_write> d_geometry: array<vec4f>;
// One plane a view of the step: xyz d_color (0 where the colour is clamped at 0).
@group(0) @binding(7) var<storage, read_write> d_color: array<vec4f>;
// How the step's first view sees each Gaussian.
@group(0) @binding(8) var<storage, read_write> screen: array<vec2f>;

const TWO_LN_2 = 1.3862943611198906;

@compute @workgroup_size(WORKGROUP)
fn project_backward(thread: Thread) {
    let id = thread_index(thread);
    if (id >= view.n_gaussians) {
        return;
    }
    let stride = view.stride;
    let slot = view.slot;
    let d = unpacked_gradient(splats[id]);
    // The second part is always true, which no compiler knows: as it stands, no branch depends on uniforms
    // only. Mesa's software driver would compile the kernel anew for every dispatch of such a one, and keep each.
    let is_first = (slot == 0u) & (d.l_xx >= 0.0);
    if (d.l_xx == 0.0) {
        if (is_first) {
            d_geometry[id] = vec4f(0.0);
            d_geometry[stride + id] = vec4f(0.0);
            d_geometry[2u * stride + id] = vec4f(0.0);
            screen[id] = stored_on_screen(OnScreen(0.0, 0.0));
        }
        d_color[slot * stride + id] = vec4f(0.0);
        return;
    }
    let g = gaussian(id);
    let o = project_gaussian(view, g);
    let l_xx = d.l_xx;
    let l_xy = d.l_xy;
    let l_yy = d.l_yy;

    // n = cov2d^-1 d: d_mean2d = sum v n, dL/dcov2d = sum v n n^T / 2, in the moments of t.
    let d_mean2d = TWO_LN_2 * vec2f(l_xx * d.x, l_xy * d.x + l_yy * d.y);
    // With L the conic's factor and T the moments of t: 2 dL/dcov2d = k^2 L^T T L. Everything goes
    // through the whitened L M and L J W, where a long splat's own direction has length 1: in
    // pixels its length would meet the inverse of its width and cancel.
    let moments = TWO_LN_2 * TWO_LN_2 * vec3f(d.xx, d.xy, d.yy);
    let root_yy = sqrt(dot(o.m_y, o.m_y) + DILATION);
    let unit_y = o.m_y / root_yy;
    // m_x - (cov_xy / cov_yy) m_y, with its cancelling part as minors.
    let w_x = l_xx * (cross(unit_y, cross(o.m_x, unit_y)) + DILATION / root_yy * (o.m_x / root_yy));
    let w_y = l_yy * o.m_y;
    let d_w_x = moments.x * w_x + moments.y * w_y;
    let d_w_y = moments.y * w_x + moments.z * w_y;
    let d_scale_log = d_w_x * w_x + d_w_y * w_y;
    // Rows of dL/d(L M S^-1): what reaches L J W R.
    let s_x = d_w_x * o.scale;
    let s_y = d_w_y * o.scale;
    let u_x = l_xx * o.t_x + l_xy * o.t_y;
    let u_y = l_yy * o.t_y;
    let d_u_x = o.rotation * s_x;
    let d_u_y = o.rotation * s_y;
    let d_t_x = l_xx * d_u_x;
    let d_t_y = l_xy * d_u_x + l_yy * d_u_y;
    let inv_z = 1.0 / o.p.hi.z;
    let focal_z = view.focal * inv_z;
    // Through x/z and y/z of the Jacobian (zero where bounded) and of the mean.
    let d_bounded = -focal_z * vec2f(dot(d_t_x, view.w2c_z.xyz), dot(d_t_y, view.w2c_z.xyz));
    let ratio = o.ratio.hi.xy;
    let unbounded = ratio == o.ratio_bounded.hi.xy;
    let d_ratio = select(vec2f(0.0), d_bounded, unbounded) + view.focal * d_mean2d;
    let d_p = vec3f(
        d_ratio * inv_z,
        // dot(d_t_x, t_x) + dot(d_t_y, t_y) is the sum over the axes.
        -inv_z * (dot(d_ratio, ratio) + (d_scale_log.x + d_scale_log.y + d_scale_log.z)),
    );
    var d_mean = d_p.x * view.w2c_x.xyz + d_p.y * view.w2c_y.xyz + d_p.z * view.w2c_z.xyz;

    if (SH_DEGREE > 0u) {
        d_mean += color_to_mean(from_center(view, g.mean), id, d.color);
    }

    // dL/drotation, column by column, then to the quaternion.
    let r_0 = s_x.x * u_x + s_y.x * u_y;
    let r_1 = s_x.y * u_x + s_y.y * u_y;
    let r_2 = s_x.z * u_x + s_y.z * u_y;
    let d_rotation = rotation_gradient(g.rotation_wxyz, r_0, r_1, r_2);

    var d_0 = vec4f(d_mean, d.opacity_logit);
    var d_1 = vec4f(d_scale_log, 0.0);
    var d_2 = d_rotation;
    if (is_first) {
        let half_size = 0.5 * vec2f(view.size);
        let cov_xx = dot(o.m_x, o.m_x) + DILATION;
        let cov_yy = dot(o.m_y, o.m_y) + DILATION;
        let cov_xy = dot(o.m_x, o.m_y);
        let largest = 0.5 * (cov_xx + cov_yy + length(vec2f(cov_xx - cov_yy, 2.0 * cov_xy)));
        let radius = 3.0 * sqrt(largest) / f32(max(view.size.x, view.size.y));
        screen[id] = stored_on_screen(OnScreen(length(d_mean2d * half_size), radius));
    } else {
        d_0 += d_geometry[id];
        d_1 += d_geometry[stride + id];
        d_2 += d_geometry[2u * stride + id];
    }
    d_geometry[id] = d_0;
    d_geometry[stride + id] = d_1;
    d_geometry[2u * stride + id] = d_2;
    d_color[slot * stride + id] = vec4f(d.color, 0.0);
}
