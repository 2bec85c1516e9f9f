//! Image files, contact sheets, tables and progress lines.

use std::io::Write;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use gspotential::metrics::ViewScore;
use gspotential::report::{
    Column, ContactSheet, Table, evaluation_table, mask_image, write_exr, write_png,
};
use gspotential::run::Evaluation;
use gspotential::scene::Image;
use gspotential::terminal::logging::{Style, line};
use gspotential::terminal::progress::Progress;

fn plain(width: u32, height: u32, color: [u8; 3]) -> Image {
    Image {
        width,
        height,
        rgb: color.repeat((width * height) as usize),
    }
}

#[test]
fn png_holds_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut picture = plain(5, 3, [9, 80, 200]);
    picture.rgb[17] = 3;
    write_png(&path, &picture).unwrap();
    let back = image::open(&path).unwrap().into_rgb8();
    assert_eq!(back.dimensions(), (5, 3));
    assert_eq!(back.into_raw(), picture.rgb);
}

#[test]
fn exr_keeps_every_float_unclamped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let values = [-2.5, 0.1, 1e6, 1e-20, 0.0, 1.0, 7.25, 0.333_333_34, -0.0];
    write_exr(&path, 3, 1, &values).unwrap();
    let image::DynamicImage::ImageRgb32F(back) = image::open(&path).unwrap() else {
        panic!("is not 32-bit float RGB");
    };
    assert_eq!(back.dimensions(), (3, 1));
    assert_eq!(back.into_raw(), values);
}

#[test]
fn pictures_of_wrong_size_and_unwritable_paths_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none/a.png");
    let error = write_png(&path, &plain(2, 2, [0; 3])).unwrap_err();
    assert!(error.to_string().contains("none/a.png"), "{error}");
    let mut short = plain(2, 2, [0; 3]);
    short.rgb.pop();
    assert!(write_png(&folder.path().join("b.png"), &short).is_err());
    assert!(write_exr(&folder.path().join("b.exr"), 2, 2, &[0.0; 11]).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn sheet_places_groups_row_by_row_and_pictures_side_by_side() {
    let (red, blue, green) = ([200, 0, 0], [0, 0, 200], [0, 200, 0]);
    let mut sheet = ContactSheet::new(3, 2, 10, 8).unwrap();
    sheet
        .add(&[&plain(10, 8, red), &plain(10, 8, blue)])
        .unwrap();
    sheet
        .add(&[&plain(10, 8, green), &plain(10, 8, red)])
        .unwrap();
    sheet
        .add(&[&plain(10, 8, blue), &plain(10, 8, green)])
        .unwrap();
    // There is no fourth place.
    assert!(
        sheet
            .add(&[&plain(10, 8, red), &plain(10, 8, red)])
            .is_err()
    );
    let page = sheet.finish();

    // Every colour covers its cells, unscaled.
    let count = |color: [u8; 3]| page.rgb.chunks_exact(3).filter(|p| *p == color).count();
    assert_eq!([count(red), count(blue), count(green)], [160, 160, 160]);
    // Read along the rows, the groups come in order.
    let order: Vec<[u8; 3]> = (0..page.height)
        .flat_map(|y| (0..page.width).map(move |x| (y * page.width + x) as usize * 3))
        .map(|i| [page.rgb[i], page.rgb[i + 1], page.rgb[i + 2]])
        .filter(|color| [red, blue, green].contains(color))
        .collect();
    assert_eq!(order[0], red);
    assert_eq!(*order.last().unwrap(), green);
}

#[test]
fn sheets_of_any_number_and_size_stay_bounded() {
    for (n_groups, group_len, width, height) in [
        (1, 1, 1, 1),
        (1, 2, 65_535, 10_000),
        (60, 2, 1600, 1067),
        (256, 2, 780, 520),
        (46, 2, 562, 1000),
        (5000, 2, 1600, 1067),
    ] {
        let page = ContactSheet::new(n_groups, group_len, width, height)
            .unwrap()
            .finish();
        assert!(page.width <= 4000 && page.height <= 4000);
        assert_eq!(page.rgb.len(), (page.width * page.height * 3) as usize);
        // A sheet that must shrink its pictures uses the room that it has.
        if n_groups >= 46 {
            assert!(
                page.width.max(page.height) > 3500,
                "{}x{}",
                page.width,
                page.height
            );
        }
    }
    for (n_groups, group_len, width, height) in [
        (0, 1, 9, 9),
        (1, 0, 9, 9),
        (1, 1, 0, 9),
        (1, 1, u32::MAX, 9),
        (usize::MAX, 1, 9, 9),
    ] {
        assert!(ContactSheet::new(n_groups, group_len, width, height).is_err());
    }
}

#[test]
fn pictures_are_averaged_down_and_odd_shapes_fit_their_cell() {
    // A fine checkerboard becomes its mean, not one of its colours.
    let mut checks = plain(7800, 5200, [0; 3]);
    for (i, pixel) in checks.rgb.chunks_exact_mut(3).enumerate() {
        if (i % 7800 + i / 7800) % 2 == 0 {
            pixel.fill(200);
        }
    }
    let mut sheet = ContactSheet::new(1, 1, 7800, 5200).unwrap();
    sheet.add(&[&checks]).unwrap();
    let page = sheet.finish();
    let middle = ((page.height / 2 * page.width + page.width / 2) * 3) as usize;
    assert!(
        (90..=110).contains(&page.rgb[middle]),
        "{}",
        page.rgb[middle]
    );

    let mut sheet = ContactSheet::new(2, 1, 20, 10).unwrap();
    sheet.add(&[&plain(1, 500, [255; 3])]).unwrap();
    sheet.add(&[&plain(500, 1, [255; 3])]).unwrap();
    assert!(sheet.finish().rgb.contains(&255));
}

#[test]
fn masks_are_as_bright_as_their_weight() {
    let picture = mask_image(3, 1, &[255, 77, 0]);
    assert_eq!(picture.rgb, [255, 255, 255, 77, 77, 77, 0, 0, 0]);
}

#[test]
fn table_is_aligned_and_names_cannot_break_it() {
    let columns = [
        Column::text("view", "view"),
        Column::number("psnr", "PSNR dB", 2),
    ];
    let mut table = Table::new("views", &columns);
    table.row(["a|b\nc".into(), 7.0.into()]);
    table.row(["d".into()]);
    assert_eq!(
        table.to_string(),
        "| view   | PSNR dB |\n\
         |--------|--------:|\n\
         | a\\|b c |    7.00 |\n\
         | d      |         |\n"
    );
}

#[test]
fn evaluation_table_tells_infinite_from_not_measured() {
    let view = |name: &str, psnr| ViewScore {
        name: name.into(),
        psnr: Some(psnr),
        ssim: Some(0.12345),
        lpips: None,
        fitted_psnr: None,
        masked: None,
        covered: None,
    };
    let mut views = vec![view("a", f64::INFINITY), view("b", 21.456)];
    let text = evaluation_table("garden", &Evaluation::new(views.clone(), 1234, None));
    let row = |start: &str| {
        let line = text.lines().find(|line| line.starts_with(start)).unwrap();
        line.split('|')
            .map(|cell| cell.trim().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(row("| a "), ["", "a", "inf", "0.1235", "n/a", ""]);
    assert_eq!(row("| b "), ["", "b", "21.46", "0.1235", "n/a", ""]);
    assert_eq!(row("| **mean")[2..5], ["inf", "0.1235", "n/a"]);
    assert!(text.contains("1234 Gaussians, trained in n/a s"), "{text}");
    assert!(!text.contains("fitted"), "{text}");
    // What is left after a fit of colours has a column where it was measured.
    views[0].fitted_psnr = Some(f64::INFINITY);
    views[1].fitted_psnr = Some(22.5);
    let text = evaluation_table("garden", &Evaluation::new(views, 1234, None));
    for part in [
        "| fitted PSNR dB |",
        "|          22.50 |",
        "Fitted: PSNR after",
    ] {
        assert!(text.contains(part), "no `{part}` in {text}");
    }
}

/// Lines that a test can read.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn progress_without_a_terminal_writes_lines_at_most_one_an_interval() {
    let run = |style, interval| {
        let out = Shared::default();
        let mut progress = Progress::lines(style, 10, Box::new(out.clone()), interval);
        (1..=10).for_each(|i| progress.update(i, 0.5 / f64::from(i), 100 + i as usize));
        progress.finish();
        let bytes = out.0.lock().unwrap().clone();
        String::from_utf8(bytes).unwrap()
    };
    assert_eq!(run(Style::Text, Duration::ZERO).lines().count(), 10);
    // Too quick for a line in between: the last state still shows.
    let text = run(Style::Text, Duration::from_secs(3600));
    assert_eq!(text.lines().count(), 1);
    for part in ["10/10", "it/s", "loss 0.0500", "110 Gaussians", "0s left"] {
        assert!(text.contains(part), "no `{part}` in {text}");
    }
    let last = run(Style::Json, Duration::from_secs(3600));
    let last: serde_json::Value = serde_json::from_str(&last).unwrap();
    assert_eq!(
        (&last["level"], &last["stage"]),
        (&"progress".into(), &"training".into())
    );
    assert_eq!((&last["done"], &last["total"]), (&10.into(), &10.into()));
    assert_eq!(
        (&last["loss"], &last["gaussians"]),
        (&0.05.into(), &110.into())
    );
    assert_eq!(last["seconds_left"], 0.0);
}

#[test]
fn messages_are_lines_or_objects() {
    let name = "a \"b\"\nc";
    assert_eq!(line(Style::Text, "info", name), name);
    assert_eq!(line(Style::Text, "warning", "x"), "warning: x");
    assert_eq!(line(Style::Text, "error", "x"), "error: x");
    let object = line(Style::Json, "warning", name);
    assert_eq!(object.lines().count(), 1);
    let object: serde_json::Value = serde_json::from_str(&object).unwrap();
    assert_eq!(
        object,
        serde_json::json!({ "level": "warning", "message": name })
    );
}
