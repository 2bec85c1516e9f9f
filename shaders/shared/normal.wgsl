// The normal of a Gaussian is its flattest axis, the first of equal ones, on the camera's side.
#import shared/gaussian
struct Normal {
    // Number of the axis.
    axis: u32,
    // 1 or -1, by which the axis is turned to the camera.
    side: f32,
    // In the camera's axes.
    normal: vec3f,
}

// `mean`: the Gaussian's in the camera's axes.
fn normal_of(view: View, g: Gaussian, mean: vec3f) -> Normal {
    let r = rotation_matrix(g.rotation_wxyz / length(g.rotation_wxyz));
    let s = g.scale_log;
    var axis = 0u;
    var column = r[0];
    var least = s.x;
    if (s.y < least) {
        axis = 1u;
        column = r[1];
        least = s.y;
    }
    if (s.z < least) {
        axis = 2u;
        column = r[2];
    }
    let n = vec3f(dot(view.w2c_x.xyz, column), dot(view.w2c_y.xyz, column), dot(view.w2c_z.xyz, column));
    let side = select(1.0, -1.0, dot(n, mean) > 0.0);
    return Normal(axis, side, side * n);
}
