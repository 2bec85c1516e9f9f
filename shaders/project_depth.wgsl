// Finds the depth and the normal of every Gaussian in the view: one thread a Gaussian.
#import shared/thread
#import shared/view
#import shared/double
#import shared/gaussian
#import shared/normal

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4f>;
// Normal in the camera's axes, and depth of the mean; nothing where the Gaussian is not drawn.
@group(0) @binding(2) var<storage, read_write> splat_depths: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn project_depth(thread: Thread) {
    let id = thread_index(thread);
    if (id >= view.n_gaussians) {
        return;
    }
    let g = gaussian(id);
    let p = to_camera(view, g.mean);
    splat_depths[id] = vec4f(normal_of(view, g, p.hi).normal, p.hi.z);
}
