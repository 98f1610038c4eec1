//! Frames of any range of grey levels.

use super::*;

/// A pair whose range lies within [128, 256), with a change of light.
fn pair() -> [Array2<f32>; 2] {
    let frames = [scene(90, 110, 0.0, 0.0), scene(90, 110, 1.7, -0.8)];
    // Whole numbers: exact in every type.
    let [prev, next] = frames.map(|frame| frame.mapv(|grey| (1.1 * grey).round()));
    [prev, next.mapv(|grey| (0.75 * grey + 9.0).round())]
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Whether `scaled` is `plain` in units of `1 / scale`, to the bit.
fn same_but_for_units(plain: &FlowField, scaled: &FlowField, scale: f32) -> bool {
    let times = |values: &[f32]| values.iter().map(|value| value * scale).collect::<Vec<_>>();
    bits(plain.uv()) == bits(scaled.uv())
        && plain.valid() == scaled.valid()
        && bits(&times(plain.residual())) == bits(scaled.residual())
        && bits(plain.light().0.data()) == bits(scaled.light().0.data())
        && bits(&times(plain.light().1.data())) == bits(scaled.light().1.data())
}

#[test]
fn the_unit_of_the_grey_levels_changes_no_bit_of_the_flow() {
    let frames = pair();
    let [prev, next] = &frames;
    for preset in PRESETS {
        let options = DenseOptions::default()
            .preset(preset)
            .illumination(Illumination::GainOffset);
        let plain = measure(prev.view(), next.view(), &options);
        let valid = plain.valid().iter().filter(|valid| **valid).count();
        assert!(2 * valid > plain.valid().len() && error(&plain, 1.7, -0.8) < 0.1);
        assert!(plain.light().1.data().iter().any(|offset| *offset != 0.0));
        for scale in [1.0 / 256.0, 1.0 / 4096.0, 1024.0] {
            let [prev, next] = frames.each_ref().map(|frame| frame * scale);
            for level in SimdLevel::available() {
                let execution = Execution::default().threads(2).level(level);
                let options = options.clone().execution(execution);
                let scaled = measure(prev.view(), next.view(), &options);
                assert!(same_but_for_units(&plain, &scaled, scale), "{scale}");
            }
        }
        let bytes = frames.each_ref().map(|frame| frame.mapv(|grey| grey as u8));
        let [prev, next] = &bytes;
        assert!(same_bits(
            &plain,
            &measure(prev.view(), next.view(), &options)
        ));
        for scale in [64, 256] {
            let deep = bytes
                .each_ref()
                .map(|frame| frame.mapv(|grey| u16::from(grey) * scale));
            let scaled = measure(deep[0].view(), deep[1].view(), &options);
            assert!(same_but_for_units(&plain, &scaled, f32::from(scale)));
        }
    }
}

#[test]
fn a_sequence_whose_range_changes_gives_the_bits_of_its_pairs() {
    let options = DenseOptions::default();
    let mut flow = DenseFlow::new(options.clone()).unwrap();
    let mut field = FlowField::default();
    let mut before: Option<Array2<f32>> = None;
    for (k, contrast) in [1.0f32, 0.004, 0.001, 40.0, 0.0, 1.0].iter().enumerate() {
        let k = k as f64;
        let mut frame = scene(60, 70, 1.3 * k, 0.4 * k).mapv(|grey| grey * contrast);
        frame[(20, 30)] = f32::NAN;
        let measured = flow.update(frame.view(), DenseHints::default(), &mut field);
        assert_eq!(measured.unwrap(), before.is_some());
        if let Some(before) = before {
            let want = measure(before.view(), frame.view(), &options);
            assert!(same_bits(&want, &field), "{contrast}");
        }
        before = Some(frame);
    }
}

#[test]
fn frames_without_a_range_are_safe() {
    let options = DenseOptions::default();
    let frame = scene(40, 50, 0.0, 0.0).mapv(|grey| grey / 256.0);
    for value in [0.0, 0.5, 1e-40, f32::MAX, f32::NAN, f32::INFINITY] {
        let flat = Array2::from_elem((40, 50), value);
        for (prev, next) in [(&flat, &frame), (&flat, &flat), (&frame, &flat)] {
            let field = measure(prev.view(), next.view(), &options);
            let valid = field.valid().iter().filter(|valid| **valid).count();
            assert_eq!(valid, 0, "{value}");
        }
    }
    let mut holed = frame.clone();
    holed[(20, 20)] = f32::INFINITY;
    let field = measure(holed.view(), holed.view(), &options);
    assert!(field.uv()[2 * (20 * 50 + 20)].is_nan());
    assert!(field.valid().iter().filter(|valid| **valid).count() > 1000);
}
