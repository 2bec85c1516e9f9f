// Finds the gradient of a view's loss with respect to a small motion of its camera, from what
// project_backward has left for the step's first view, before the second adds to it.
//
// To the camera, a shift is one of all means, and a turn about its own centre is one of all Gaussians
// about that centre, means and rotations, but for their colours: these depend on the direction from
// the centre in the world, which such a turn leaves. So the sums run over d_mean and over
// the torques offset x d_mean (less the colour's part) + that of d_rotation, in a fixed order:
// each workgroup its own, then one workgroup the others'.
#import shared/thread
#import shared/view
#import shared/sh
#import shared/sh_mean

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4f>;
@group(0) @binding(2) var<storage, read> sh_0: array<vec4f>;
@group(0) @binding(3) var<storage, read> sh_2: array<vec4f>;
@group(0) @binding(4) var<storage, read> sh_3: array<vec4f>;
@group(0) @binding(5) var<storage, read> d_geometry: array<vec4f>;
@group(0) @binding(6) var<storage, read> d_color: array<vec4f>;
// Per workgroup of pose_backward, in the axes of the means.
@group(0) @binding(7) var<storage, read_write> pose_sums: array<Motion>;
// In the camera's axes.
@group(0) @binding(8) var<storage, read_write> d_pose: Motion;

// The gradient with respect to a motion.
struct Motion {
    // Per radian.
    turn: vec3f,
    // Per unit of length.
    shift: vec3f,
}

var<workgroup> turns: array<vec3f, WORKGROUP>;
var<workgroup> shifts: array<vec3f, WORKGROUP>;

// The sums over the workgroup, in the first thread's `turns[0]` and `shifts[0]`.
fn sum_workgroup(local: u32, turn: vec3f, shift: vec3f) {
    turns[local] = turn;
    shifts[local] = shift;
    workgroupBarrier();
    if (local == 0u) {
        // bound: WORKGROUP turns.
        for (var i = 1u; i < WORKGROUP; i++) {
            turns[0] += turns[i];
            shifts[0] += shifts[i];
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn pose_backward(thread: Thread) {
    let block = workgroup_index(thread);
    let id = block * WORKGROUP + thread.local;
    var turn = vec3f(0.0);
    var shift = vec3f(0.0);
    if (id < view.n_gaussians) {
        let stride = view.stride;
        let offset = from_center(view, geometry[id].xyz);
        let q = geometry[2u * stride + id];
        let d_q = d_geometry[2u * stride + id];
        var d_mean = d_geometry[id].xyz;
        shift = d_mean;
        let d_c = d_color[id].xyz;
        if (SH_DEGREE > 0u) {
            // A Gaussian without a gradient may lie in the camera's centre.
            if (any(d_c != vec3f(0.0))) {
                d_mean -= color_to_mean(offset, id, d_c);
            }
        }
        // A turn t is (0, t / 2) q for the quaternion.
        let torque = q.x * d_q.yzw - d_q.x * q.yzw + cross(q.yzw, d_q.yzw);
        turn = cross(offset, d_mean) + 0.5 * torque;
    }
    sum_workgroup(thread.local, turn, shift);
    if (thread.local == 0u && block * WORKGROUP < view.n_gaussians) {
        pose_sums[block] = Motion(turns[0], shifts[0]);
    }
}

@compute @workgroup_size(WORKGROUP)
fn pose_total(thread: Thread) {
    let n_blocks = (view.n_gaussians + WORKGROUP - 1u) / WORKGROUP;
    let chunk = (n_blocks + WORKGROUP - 1u) / WORKGROUP;
    var turn = vec3f(0.0);
    var shift = vec3f(0.0);
    // bound: n / WORKGROUP^2 + 1 turns, n below 2^27: a Gaussian's geometry takes 48 bytes of a binding.
    for (var i = thread.local * chunk; i < min((thread.local + 1u) * chunk, n_blocks); i++) {
        turn += pose_sums[i].turn;
        shift += pose_sums[i].shift;
    }
    sum_workgroup(thread.local, turn, shift);
    if (thread.local == 0u) {
        let w = mat3x3f(view.w2c_x.xyz, view.w2c_y.xyz, view.w2c_z.xyz);
        // v * w is the product of w's transpose: w's columns are the rotation's rows.
        d_pose = Motion(turns[0] * w, shifts[0] * w);
    }
}
