// Composites depths and normals as rasterize does colours: one thread a tile of 4 x TILE_H pixels, each
// row in variables of its own.
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
#import shared/thread_tile
#import shared/depth_forward

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth(thread: Thread) {
    composite(thread_index(thread), 0u, false);
}

// The next LIST_SLICE entries of every list; what goes on leaves its state in `depths`.
@compute @workgroup_size(WORKGROUP)
fn rasterize_depth_slice(thread: Thread) {
    composite(thread_index(thread), slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left.
fn composite(thread: u32, slice_first: u32, sliced: bool) {
    let tile = thread_tile(thread);
    if (!tile.exists) {
        return;
    }
    #repeat r TILE_H
    var row_{r}: DepthPixels;
    #end
    #repeat r TILE_H
    row_{r}.transmittance = vec4f(1.0);
    #end

    let entries = entries_of(tile.list, slice_first, sliced);
    if (entries.is_over) {
        return;
    }
    if (sliced) {
        // Depends on the list, too: see project_backward on branches on uniforms alone.
        if (slice_first > 0u && slice_first < tile.list.end - tile.list.first) {
            #repeat r TILE_H
            row_{r} = loaded_depths(tile.x4, tile.y + {r}u);
            #end
        }
    }
    // bound: LIST_SLICE turns; order_tiles hands out no longer list, and the step is taken again in
    // slices.
    for (var i = entries.first; i < entries.end; i++) {
        let gaussian = tile_splat(tile_splats[i]).gaussian;
        let s = unpacked(splats[gaussian]);
        let f = splat_depths[gaussian];
        let t_x0 = s.t_0.x + s.l_xx * (tile.px - s.anchor.x);
        let number = i - tile.list.first + 1u;
        var most = vec4f(-1.0);
        #repeat r TILE_H
        {
            let dy = tile.py + {r}.0 - s.anchor.y;
            let t_y = s.t_0.y + s.l_yy * dy;
            let t_x = t_x0 + s.l_xy * dy;
            blend_depth(&row_{r}, number, s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y)), f);
            most = max(most, row_{r}.transmittance);
        }
        #end
        if (all(most < vec4f(0.0))) {
            break;
        }
    }
    let goes_on = sliced && entries.end < tile.list.end;
    #repeat r TILE_H
    store_depths(row_{r}, tile.x4, tile.y + {r}u, goes_on);
    #end
}
