// The rasterizers of one thread a tile share this: the tile is 4 x TILE_H pixels, of which a row is one vec4f.

struct ThreadTile {
    list: Range,
    // Vector of four pixels across, and first row.
    x4: u32,
    y: u32,
    // Centres of the first row's pixels.
    px: vec4f,
    py: f32,
    // Whether the thread has one.
    exists: bool,
}

fn thread_tile(thread: u32) -> ThreadTile {
    // Beyond the last block this reads another's entry or, held to the bounds, the last.
    let list = tile_list(tile_order[thread]);
    let x4 = list.tile % view.tiles.x;
    let y = (list.tile / view.tiles.x) * TILE_H;
    let px = vec4f(0.5, 1.5, 2.5, 3.5) + f32(4u * x4);
    return ThreadTile(list.range, x4, y, px, f32(y) + 0.5, list.tile < view.tiles.x * view.tiles.y);
}
