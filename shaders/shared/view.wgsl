// One rendered view: camera in the canonical frame, image and buffer sizes. 288 bytes. Numbers of
// which differences are formed have low parts, which hold the digits that f32 has no room for.
struct View {
    // Rows of world-to-camera [R | t].
    w2c_x: vec4f,
    w2c_y: vec4f,
    w2c_z: vec4f,
    w2c_low_x: vec4f,
    w2c_low_y: vec4f,
    w2c_low_z: vec4f,
    // Optical centre and near plane.
    center: vec3f,
    near: f32,
    center_low: vec3f,
    // 0, which the compiler does not know.
    zero: f32,
    // Focal lengths and principal point, pixels.
    focal: vec2f,
    principal: vec2f,
    focal_low: vec2f,
    principal_low: vec2f,
    // Bounds of x/z and y/z in the projection's Jacobian.
    ratio_min: vec2f,
    ratio_max: vec2f,
    ratio_min_low: vec2f,
    ratio_max_low: vec2f,
    // Colour behind the last Gaussian.
    background: vec3f,
    pad_0: f32,
    // Width and height, pixels.
    size: vec2u,
    // Tiles across and down.
    tiles: vec2u,
    n_gaussians: u32,
    // Entries a plane of the Gaussians' buffers.
    stride: u32,
    // 2^32 times the probability of dropout, and its key.
    drop_threshold: u32,
    drop_key: u32,
    // vec4s a plane of the padded image, and a row of it.
    plane_vectors: u32,
    row_vectors: u32,
    // This view's place among those of the step.
    slot: u32,
    // Longest list of a tile that the step's slices cover.
    longest_list: u32,
    // A Gaussian's share of the dropout's probability: base + per_distance d + per_density rho.
    share_base: f32,
    share_per_distance: f32,
    share_per_density: f32,
    // 1 where the others' opacity makes up for the Gaussians that are left out, else 0.
    compensates: f32,
    // Distances from the optical centre up to which that share counts in full, and at 0.7.
    near_layer: f32,
    middle_layer: f32,
    // The plane of `d_rendered` that holds what each pixel has blended last.
    blended_plane: u32,
    pad_1: u32,
}

// `p` less the optical centre.
fn from_center(view: View, p: vec3f) -> vec3f {
    return (p - view.center) - view.center_low;
}

// Colour, transmittance and gradients of four pixels side by side are one vec4f, so an image
// plane is an array<vec4f> of rows padded to whole tiles.
fn plane_index(view: View, plane: u32, x4: u32, y: u32) -> u32 {
    return plane * view.plane_vectors + y * view.row_vectors + x4;
}
