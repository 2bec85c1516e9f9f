// Composites each tile's splats front to back, as rasterize does and to the same bits, for GPUs: one
// workgroup a tile. Its threads fetch WORKGROUP splats together, each blends them in its own four pixels,
// and the list ends once no pixel of the tile takes more.
#import shared/thread
#import shared/view
#import shared/splat
#import shared/entries

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<SplatVectors>;
@group(0) @binding(2) var<storage, read> tile_order: array<vec4u>;
@group(0) @binding(3) var<storage, read> tile_splats: array<vec2u>;
// Planes r, g, b, final transmittance.
@group(0) @binding(4) var<storage, read_write> rendered: array<vec4f>;
// Plane `view.blended_plane`, per pixel: one past the last blended splat, counted from its tile's first.
@group(0) @binding(5) var<storage, read_write> d_rendered: array<vec4u>;
@group(0) @binding(6) var<uniform> slice: Slice;

#import shared/tile
#import shared/group_tile

// The splats that are blended now.
var<workgroup> staged: array<SplatVectors, WORKGROUP>;
// One more than the first entry of the last such batch that has left a pixel open.
var<workgroup> last_open: atomic<u32>;

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize(thread: Thread) {
    composite(thread, 0u, false);
}

// The next LIST_SLICE entries of every list, with the state of rasterize's.
@compute @workgroup_size(WORKGROUP)
fn rasterize_slice(thread: Thread) {
    composite(thread, slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left. All threads
// reach every barrier: the list is one of the whole workgroup.
fn composite(thread: Thread, slice_first: u32, sliced: bool) {
    let list = group_list(thread);
    let at = group_pixels(list.tile, thread.local);
    var red: vec4f;
    var green: vec4f;
    var blue: vec4f;
    var last: vec4u;
    // Negative once a pixel takes no more splats, as those outside never do.
    var transmittance = select(vec4f(-1.0), vec4f(1.0), at.inside);

    let entries = entries_of(list.range, slice_first, sliced);
    let writes = at.inside && !entries.is_over;
    if (sliced) {
        // Depends on the list, too: see project_backward on branches on uniforms alone.
        if (writes && slice_first > 0u) {
            red = rendered[plane_index(view, 0u, at.x4, at.y)];
            green = rendered[plane_index(view, 1u, at.x4, at.y)];
            blue = rendered[plane_index(view, 2u, at.x4, at.y)];
            transmittance = rendered[plane_index(view, 3u, at.x4, at.y)];
            last = d_rendered[plane_index(view, view.blended_plane, at.x4, at.y)];
        }
    }
    // bound: LIST_SLICE / WORKGROUP turns; order_tiles hands out no longer list, and the step is taken
    // again in slices.
    for (var begin = entries.first; begin < entries.end; begin += WORKGROUP) {
        let n = min(WORKGROUP, entries.end - begin);
        if (thread.local < n) {
            staged[thread.local] = splats[tile_splat(tile_splats[begin + thread.local]).gaussian];
        }
        workgroupBarrier();
        // bound: WORKGROUP turns.
        for (var i = 0u; i < n && any(transmittance > vec4f(0.0)); i++) {
            let s = unpacked(staged[i]);
            let dy = at.py - s.anchor.y;
            let t_y = s.t_0.y + s.l_yy * dy;
            if (is_beyond(s.reach, t_y)) {
                continue;
            }
            let t_x = (s.t_0.x + s.l_xx * (at.px - s.anchor.x)) + s.l_xy * dy;
            let raw = s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y));
            let drawn = raw >= vec4f(ALPHA_MIN);
            // 0 leaves everything below as it is, to the bit.
            let alpha = select(vec4f(0.0), min(vec4f(ALPHA_MAX), raw), drawn);
            let next = transmittance * (1.0 - alpha);
            let kept = next > vec4f(TRANSMITTANCE_MIN);
            let weight = select(vec4f(0.0), alpha * transmittance, kept);
            red += s.color.x * weight;
            green += s.color.y * weight;
            blue += s.color.z * weight;
            last = select(last, vec4u(begin + i - list.range.first + 1u), drawn & kept);
            transmittance = select(-abs(transmittance), next, kept);
        }
        if (any(transmittance > vec4f(0.0))) {
            atomicMax(&last_open, begin + 1u);
        }
        workgroupBarrier();
        // The next batch's votes follow its first barrier, and so this.
        if (atomicLoad(&last_open) <= begin) {
            break;
        }
    }

    if (writes) {
        let goes_on = sliced && entries.end < list.range.end;
        let t = select(abs(transmittance), transmittance, goes_on);
        let background = select(view.background, vec3f(0.0), goes_on);
        rendered[plane_index(view, 0u, at.x4, at.y)] = red + background.x * t;
        rendered[plane_index(view, 1u, at.x4, at.y)] = green + background.y * t;
        rendered[plane_index(view, 2u, at.x4, at.y)] = blue + background.z * t;
        rendered[plane_index(view, 3u, at.x4, at.y)] = t;
        d_rendered[plane_index(view, view.blended_plane, at.x4, at.y)] = last;
    }
}
