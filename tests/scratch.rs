use gspotential::gpu::Gpu;
use gspotential::render::*;
use gspotential::*;
use std::path::Path;
#[test]
fn fixture() {
    let t = std::time::Instant::now();
    let gpu = Gpu::open().unwrap();
    println!("{} open {:?}", gpu.describe(), t.elapsed());
    let t = std::time::Instant::now();
    let kernels = Kernels::new(&gpu);
    println!("kernels {:?}", t.elapsed());
    for case in ["garden", "random", "huge", "near"] {
        let dir = Path::new("../shared/fixtures").join(case);
        let g = gaussians::ply::read_ply(&dir.join("gaussians.ply")).unwrap();
        let model = Model::upload(&gpu, &g, g.len()).unwrap();
        let cams: serde_json::Value =
            serde_json::from_slice(&std::fs::read(dir.join("cameras.json")).unwrap()).unwrap();
        let mut r = Renderer::new(&gpu, &kernels);
        for (k, c) in cams.as_array().unwrap().iter().enumerate() {
            let f = |n: &str| c[n].as_f64().unwrap();
            let w2c = &c["w2c"];
            let m = |i: usize, j: usize| w2c[i][j].as_f64().unwrap();
            let cam = camera::Camera {
                name: "x".into(),
                width: f("width") as u32,
                height: f("height") as u32,
                fx: f("fx"),
                fy: f("fy"),
                cx: f("cx"),
                cy: f("cy"),
                rotation: glam::DMat3::from_cols_array(&[
                    m(0, 0),
                    m(1, 0),
                    m(2, 0),
                    m(0, 1),
                    m(1, 1),
                    m(2, 1),
                    m(0, 2),
                    m(1, 2),
                    m(2, 2),
                ]),
                translation: glam::DVec3::new(m(0, 3), m(1, 3), m(2, 3)),
            };
            let deg = f("sh_degree") as u32;
            if deg != g.sh_degree {
                println!("deg {deg}");
            }
            let v = ViewUniform::new(&cam, f("near"), [0.0; 3]);
            let t = std::time::Instant::now();
            let out = r.render(&model, &v).unwrap();
            let dt = t.elapsed();
            for _ in 0..3 {
                let t = std::time::Instant::now();
                r.render(&model, &v).unwrap();
                println!("   again {:?}", t.elapsed());
            }
            let npy = |n: &str| {
                let b = std::fs::read(dir.join(format!("cam{k}_{n}.npy"))).unwrap();
                let h = u16::from_le_bytes([b[8], b[9]]) as usize;
                b[10 + h..].to_vec()
            };
            let rgb: Vec<f32> = bytemuck::pod_collect_to_vec(&npy("rgb"));
            let fr = npy("fragile");
            let mut e = 0f32;
            let mut ef = 0f32;
            for i in 0..out.alpha.len() {
                for ch in 0..3 {
                    let d = (out.rgb[3 * i + ch] - rgb[3 * i + ch]).abs();
                    if fr[i] == 0 {
                        e = e.max(d)
                    } else {
                        ef = ef.max(d)
                    }
                }
            }
            println!("{case} {k}: err {e:e} fragile {ef:e}  {dt:?}");
        }
    }
}
