//! How far a window moved between two pictures, where points went, and where every pixel went.
//!
//! `cargo run --release --example displacement [PREV.pgm NEXT.pgm]`; without pictures on a made pair.

use std::error::Error;
use std::path::Path;

use lk_core::ndarray::Array2;
use lk_core::{
    CornerOptions, DenseHints, DenseOptions, Masks, ShiftOptions, TrackOptions, dense_flow,
    detect_corners, estimate_shift, track_points,
};

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = std::env::args().skip(1);
    match (paths.next(), paths.next()) {
        (Some(prev), Some(next)) => measure(&pgm(prev.as_ref())?, &pgm(next.as_ref())?),
        _ => measure(&made(0.0, 0.0), &made(2.25, -1.5)),
    }
}

fn measure(prev: &Array2<u8>, next: &Array2<u8>) -> Result<(), Box<dyn Error>> {
    let (prev, next) = (prev.view(), next.view());
    let mut out = std::io::stdout().lock();
    use std::io::Write;

    let shift = estimate_shift(prev, next, Masks::default(), &ShiftOptions::default())?;
    let (dx, dy, status) = (shift.dx, shift.dy, shift.status);
    writeln!(
        out,
        "the whole picture: ({dx:+.3}, {dy:+.3}) px, {status:?}"
    )?;

    let corners = detect_corners(prev, None, &CornerOptions::default().max_corners(100))?;
    let points: Vec<[f32; 2]> = corners.iter().map(|corner| corner.position).collect();
    let tracks = track_points(
        prev,
        next,
        &points,
        None,
        Masks::default(),
        &TrackOptions::default(),
    )?;
    let tracked = tracks.iter().filter(|track| track.is_valid()).count();
    writeln!(out, "points: {tracked} of {} tracked", points.len())?;

    let flow = dense_flow(prev, next, DenseHints::default(), &DenseOptions::default())?;
    let (uv, x, y) = (flow.uv_view(), flow.width() / 2, flow.height() / 2);
    let (u, v) = (uv[(y, x, 0)], uv[(y, x, 1)]);
    writeln!(out, "the pixel in the middle: ({u:+.3}, {v:+.3}) px")?;
    Ok(())
}

/// A scene without period, moved by (dx, dy).
fn made(dx: f32, dy: f32) -> Array2<u8> {
    Array2::from_shape_fn((120, 160), |(y, x)| {
        let (x, y) = (x as f32 - dx, y as f32 - dy);
        let waves =
            (0.4 * x + 0.1 * y).sin() * (0.3 * y).cos() + (0.013 * x * y / 8.0 + 0.2 * y).sin();
        (128.0 + 50.0 * waves).round() as u8
    })
}

/// A binary grey picture, 8 bits deep.
fn pgm(path: &Path) -> Result<Array2<u8>, Box<dyn Error>> {
    let bytes = std::fs::read(path)?;
    let mut at = 0;
    let mut words = Vec::new();
    while words.len() < 4 {
        let rest = bytes.get(at..).ok_or("the header ends early")?;
        let line = rest.iter().position(|byte| byte.is_ascii_whitespace());
        let word = std::str::from_utf8(&rest[..line.ok_or("the header ends early")?])?;
        at += word.len() + 1;
        if !word.is_empty() {
            words.push(word.to_owned());
        }
    }
    if words[0] != "P5" || words[3] != "255" {
        return Err("expected a binary grey picture, 8 bits deep (P5, 255)".into());
    }
    let (width, height) = (words[1].parse()?, words[2].parse()?);
    Ok(Array2::from_shape_vec(
        (height, width),
        bytes[at..].to_vec(),
    )?)
}

#[cfg(test)]
mod tests {
    #[test]
    fn runs() {
        super::main().unwrap();
    }
}
