// The rasterizers of one workgroup a tile share this: the tile is GROUP_TILE x GROUP_TILE pixels, and a
// thread has four of them side by side, in one vec4f each of colour, transmittance and the rest.

// Vectors of four pixels a row of a tile.
const GROUP_VECTORS = GROUP_TILE / 4u;

// The list of the workgroup's tile; where it has none, the number of tiles and an empty list.
fn group_list(thread: Thread) -> TileList {
    let n_tiles = view.tiles.x * view.tiles.y;
    let n_blocks = ((view.tiles.x + BLOCK_W - 1u) / BLOCK_W) * ((view.tiles.y + BLOCK_H - 1u) / BLOCK_H);
    let group = workgroup_index(thread);
    let list = tile_list(tile_order[group]);
    // A folded grid has workgroups beyond the last block, which would read another's entry.
    if (group >= n_blocks * WORKGROUP || list.tile >= n_tiles) {
        return TileList(n_tiles, Range(0u, 0u));
    }
    return list;
}

// The four pixels of a thread.
struct GroupPixels {
    x4: u32,
    y: u32,
    // Their centres.
    px: vec4f,
    py: f32,
    // In the padded image.
    inside: bool,
}

fn group_pixels(tile: u32, local: u32) -> GroupPixels {
    let x4 = (tile % view.tiles.x) * GROUP_VECTORS + local % GROUP_VECTORS;
    let y = (tile / view.tiles.x) * GROUP_TILE + local / GROUP_VECTORS;
    let n_rows = view.plane_vectors / view.row_vectors;
    let px = vec4f(0.5, 1.5, 2.5, 3.5) + f32(4u * x4);
    return GroupPixels(x4, y, px, f32(y) + 0.5, tile < view.tiles.x * view.tiles.y && x4 < view.row_vectors && y < n_rows);
}

// Whether a splat is nowhere drawn in a row of pixels: reach bounds t_x^2 + t_y^2, and rounding may not lose a pixel.
// Waves of 32 have half a tile's rows, and skip a splat that none of these meets.
fn is_beyond(reach: f32, t_y: f32) -> bool {
    return t_y * t_y > reach * 1.0001 + 1e-4;
}
