// Composites depths and normals, as rasterize_depth does, for GPUs: one workgroup a tile, as
// rasterize_workgroup.
#import shared/thread
#import shared/view
#import shared/splat
#import shared/entries

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<SplatVectors>;
// Normal in the camera's axes, and depth, a Gaussian.
@group(0) @binding(2) var<storage, read> splat_depths: array<vec4f>;
@group(0) @binding(3) var<storage, read> tile_order: array<vec4u>;
@group(0) @binding(4) var<storage, read> tile_splats: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> depths: array<vec4u>;
@group(0) @binding(6) var<uniform> slice: Slice;

#import shared/tile
#import shared/group_tile
#import shared/depth_forward

// The splats that are blended now.
var<workgroup> staged: array<SplatVectors, WORKGROUP>;
var<workgroup> staged_depths: array<vec4f, WORKGROUP>;
// One more than the first entry of the last such batch that has left a pixel open.
var<workgroup> last_open: atomic<u32>;

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth(thread: Thread) {
    composite(thread, 0u, false);
}

// The next LIST_SLICE entries of every list, with the state of rasterize_depth's.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth_slice(thread: Thread) {
    composite(thread, slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left. All threads
// reach every barrier: the list is one of the whole workgroup.
fn composite(thread: Thread, slice_first: u32, sliced: bool) {
    let list = group_list(thread);
    let at = group_pixels(list.tile, thread.local);
    var pixels: DepthPixels;
    // Negative once a pixel takes no more splats, as those outside never do.
    pixels.transmittance = select(vec4f(-1.0), vec4f(1.0), at.inside);

    let entries = entries_of(list.range, slice_first, sliced);
    let writes = at.inside && !entries.is_over;
    if (sliced) {
        // Depends on the list, too: see project_backward on branches on uniforms alone.
        if (writes && slice_first > 0u) {
            pixels = loaded_depths(at.x4, at.y);
        }
    }
    // bound: LIST_SLICE / WORKGROUP turns; order_tiles hands out no longer list, and the step is taken
    // again in slices.
    for (var begin = entries.first; begin < entries.end; begin += WORKGROUP) {
        let n = min(WORKGROUP, entries.end - begin);
        if (thread.local < n) {
            let gaussian = tile_splat(tile_splats[begin + thread.local]).gaussian;
            staged[thread.local] = splats[gaussian];
            staged_depths[thread.local] = splat_depths[gaussian];
        }
        workgroupBarrier();
        // bound: WORKGROUP turns.
        for (var i = 0u; i < n && any(pixels.transmittance > vec4f(0.0)); i++) {
            let s = unpacked(staged[i]);
            let dy = at.py - s.anchor.y;
            let t_y = s.t_0.y + s.l_yy * dy;
            let t_x = (s.t_0.x + s.l_xx * (at.px - s.anchor.x)) + s.l_xy * dy;
            let raw = s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y));
            blend_depth(&pixels, begin + i - list.range.first + 1u, raw, staged_depths[i]);
        }
        if (any(pixels.transmittance > vec4f(0.0))) {
            atomicMax(&last_open, begin + 1u);
        }
        workgroupBarrier();
        // The next batch's votes follow its first barrier, and so this.
        if (atomicLoad(&last_open) <= begin) {
            break;
        }
    }
    if (writes) {
        store_depths(pixels, at.x4, at.y, sliced && entries.end < list.range.end);
    }
}
