// Composites each tile's splats front to back: one thread a tile of 4 x TILE_H pixels, for drivers that
// run on a CPU (rasterize_workgroup is for GPUs). It keeps the tile's rows as vec4f, each in variables of
// its own (an array of them would live in memory). No thread ever needs another's result, so there is
// no barrier, no workgroup memory and no reduction across threads.
//
// alpha = min(ALPHA_MAX, opacity 2^-|t|^2); alpha < ALPHA_MIN is skipped; a splat that would take
// the transmittance to TRANSMITTANCE_MIN or below is not blended and ends its pixel.
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
#import shared/thread_tile

// All of every list, which has at most LIST_SLICE entries.
@compute @workgroup_size(WORKGROUP)
fn rasterize(thread: Thread) {
    composite(thread_index(thread), 0u, false);
}

// The next LIST_SLICE entries of every list. A tile whose list goes on leaves its state in
// `rendered`, colours without background and the transmittance with its sign, and in `d_rendered`.
@compute @workgroup_size(WORKGROUP)
fn rasterize_slice(thread: Thread) {
    composite(thread_index(thread), slice.first, true);
}

// `sliced` is known where the function is compiled: without slices nothing of them is left.
fn composite(thread: u32, slice_first: u32, sliced: bool) {
    let tile = thread_tile(thread);
    if (!tile.exists) {
        return;
    }
    #repeat r TILE_H
    var red_{r}: vec4f;
    var green_{r}: vec4f;
    var blue_{r}: vec4f;
    // Negative once a pixel takes no more splats.
    var transmittance_{r}: vec4f;
    var last_{r}: vec4u;
    #end
    #repeat r TILE_H
    transmittance_{r} = vec4f(1.0);
    #end

    let entries = entries_of(tile.list, slice_first, sliced);
    if (entries.is_over) {
        return;
    }
    if (sliced) {
        // Depends on the list, too: see project_backward on branches on uniforms alone.
        if (slice_first > 0u && slice_first < tile.list.end - tile.list.first) {
            #repeat r TILE_H
            red_{r} = rendered[plane_index(view, 0u, tile.x4, tile.y + {r}u)];
            green_{r} = rendered[plane_index(view, 1u, tile.x4, tile.y + {r}u)];
            blue_{r} = rendered[plane_index(view, 2u, tile.x4, tile.y + {r}u)];
            transmittance_{r} = rendered[plane_index(view, 3u, tile.x4, tile.y + {r}u)];
            last_{r} = d_rendered[plane_index(view, view.blended_plane, tile.x4, tile.y + {r}u)];
            #end
        }
    }
    // bound: LIST_SLICE turns; order_tiles hands out no longer list, and the step is taken again in
    // slices.
    for (var i = entries.first; i < entries.end; i++) {
        let s = unpacked(splats[tile_splat(tile_splats[i]).gaussian]);
        let t_x0 = s.t_0.x + s.l_xx * (tile.px - s.anchor.x);
        let number = vec4u(i - tile.list.first + 1u);
        var most = vec4f(-1.0);
        #repeat r TILE_H
        {
            let dy = tile.py + {r}.0 - s.anchor.y;
            let t_y = s.t_0.y + s.l_yy * dy;
            let t_x = t_x0 + s.l_xy * dy;
            let raw = s.opacity * exp2_negative(-(t_x * t_x + t_y * t_y));
            let drawn = raw >= vec4f(ALPHA_MIN);
            // 0 leaves everything below as it is, to the bit.
            let alpha = select(vec4f(0.0), min(vec4f(ALPHA_MAX), raw), drawn);
            let next = transmittance_{r} * (1.0 - alpha);
            let kept = next > vec4f(TRANSMITTANCE_MIN);
            let weight = select(vec4f(0.0), alpha * transmittance_{r}, kept);
            red_{r} += s.color.x * weight;
            green_{r} += s.color.y * weight;
            blue_{r} += s.color.z * weight;
            last_{r} = select(last_{r}, number, drawn & kept);
            transmittance_{r} = select(-abs(transmittance_{r}), next, kept);
            most = max(most, transmittance_{r});
        }
        #end
        if (all(most < vec4f(0.0))) {
            break;
        }
    }

    #repeat r TILE_H
    {
        let goes_on = sliced && entries.end < tile.list.end;
        let t = select(abs(transmittance_{r}), transmittance_{r}, goes_on);
        let background = select(view.background, vec3f(0.0), goes_on);
        rendered[plane_index(view, 0u, tile.x4, tile.y + {r}u)] = red_{r} + background.x * t;
        rendered[plane_index(view, 1u, tile.x4, tile.y + {r}u)] = green_{r} + background.y * t;
        rendered[plane_index(view, 2u, tile.x4, tile.y + {r}u)] = blue_{r} + background.z * t;
        rendered[plane_index(view, 3u, tile.x4, tile.y + {r}u)] = t;
        d_rendered[plane_index(view, view.blended_plane, tile.x4, tile.y + {r}u)] = last_{r};
    }
    #end
}
