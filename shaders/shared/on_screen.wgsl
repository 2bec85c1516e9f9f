// What densification looks at of a Gaussian in a view.
struct OnScreen {
    // |d_mean2d| in normalised device coordinates.
    gradient: f32,
    // Radius as a share of the image's longer side; 0: not drawn.
    radius: f32,
}

fn stored_on_screen(s: OnScreen) -> vec2f {
    return vec2f(s.gradient, s.radius);
}

fn on_screen(v: vec2f) -> OnScreen {
    return OnScreen(v.x, v.y);
}
