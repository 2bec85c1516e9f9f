//! This module reads `cameras.bin` and `images.bin`: little-endian, counts as `u64`.

use super::{Model, StatedCamera, StatedPose, cameras};
use crate::error::{Error, Result};
use crate::files::bytes::Reader;

/// id, model and size of a camera without its parameters.
const CAMERA_BYTES: usize = 4 + 4 + 8 + 8;
/// id, rotation, translation, camera id, an empty name and the number of its points.
const IMAGE_BYTES: usize = 4 + 4 * 8 + 3 * 8 + 4 + 1 + 8;
/// x, y and point id of an observation.
const POINT2D_BYTES: usize = 8 + 8 + 8;

pub(crate) fn read_cameras(bytes: &[u8], model: &mut Model) -> Result<()> {
    let mut reader = Reader::new(bytes);
    for _ in 0..reader.count(CAMERA_BYTES, "cameras")? {
        let at = reader.position();
        let here = |e: Error| e.at(format_args!("byte {at}"));
        let id = i64::from(reader.i32("a camera's id")?);
        let (model_name, n_params) =
            cameras::by_id(id, reader.i32("a camera's model")?).map_err(here)?;
        let size = [
            reader.u64("a camera's width")?,
            reader.u64("a camera's height")?,
        ];
        let params = (0..n_params)
            .map(|_| reader.f64("a camera's parameters"))
            .collect::<Result<Vec<f64>>>()?;
        let place = format!("byte {at}");
        let camera = StatedCamera {
            id,
            model: model_name,
            size,
            params,
        };
        model.add_camera(&place, camera)?;
    }
    Ok(())
}

pub(crate) fn read_images(bytes: &[u8], model: &mut Model) -> Result<()> {
    let mut reader = Reader::new(bytes);
    for _ in 0..reader.count(IMAGE_BYTES, "images")? {
        let at = reader.position();
        let here = |e: Error| e.at(format_args!("byte {at}"));
        reader.i32("an image's id")?;
        let pose = StatedPose {
            rotation_wxyz: reader.f64s("an image's rotation")?,
            translation: reader.f64s("an image's translation")?,
            camera_id: i64::from(reader.i32("an image's camera id")?),
        };
        let name = reader.nul_terminated("an image's name")?;
        let name = std::str::from_utf8(name).map_err(|_| {
            here(Error::new(format!(
                "image name `{}` is not UTF-8",
                name.escape_ascii()
            )))
            .way_out("rename the image and rebuild the model")
        })?;
        model.add_image(pose, name).map_err(here)?;
        reader.skip_list(POINT2D_BYTES, "points of an image")?;
    }
    Ok(())
}
