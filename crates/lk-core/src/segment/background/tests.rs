use super::super::background_kernels::{Sort, sample_of};
use super::*;
use crate::segment::made::{Numbers, greys, mask};

#[test]
fn columns_are_sorted() {
    let mut block = [[0i16; BLOCK]; SAMPLES];
    for (k, row) in block.iter_mut().enumerate() {
        for (x, value) in row.iter_mut().enumerate() {
            *value = (hashed(1, k as u64, x as u64) % 2000) as i16 - 1000;
        }
    }
    let mut want = block;
    for x in 0..BLOCK {
        let mut column: Vec<i16> = block.iter().map(|row| row[x]).collect();
        column.sort_unstable();
        for (row, value) in want.iter_mut().zip(column) {
            row[x] = value;
        }
    }
    dispatch(crate::SimdLevel::detected(), Sort(&mut block));
    assert_eq!(block, want);
}

#[test]
fn single_values_are_rounded_as_those_in_lanes() {
    let mut numbers = Numbers::new(9);
    let odd = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        -0.03125,
        0.0,
        1e9,
        -1e9,
        3e38,
    ];
    let many = (0..20_000).map(|_| (400.0 * numbers.normal()) as f32);
    for value in many.chain(odd) {
        assert_eq!(one_sample_of(value), sample_of(value), "{value}");
    }
}

#[test]
fn what_was_seen_is_near_and_its_median_is_known() {
    let size = (70, 9);
    let pixels = size.0 * size.1;
    let mut model = Background::default();
    model.reset(size).unwrap();
    let (seen, none) = (vec![1; pixels], vec![0; pixels]);
    let execution = Execution::default();
    for t in 0..30 {
        let picture: Vec<f32> = (0..pixels)
            .map(|k| (k % 200) as f32 + (t % 3) as f32)
            .collect();
        model
            .learn(&picture, [&seen, &none, &none], &execution)
            .unwrap();
    }
    let picture: Vec<f32> = (0..pixels)
        .map(|k| (k % 200) as f32 + 1.0 + 9.0 * f32::from(u8::from(k % 7 == 0)))
        .collect();
    let mut apart = vec![0.0; pixels];
    model
        .distances(&picture, 0.0, &mut apart, &execution)
        .unwrap();
    for (k, apart) in apart.iter().enumerate() {
        assert!(
            if k % 7 == 0 {
                *apart >= 8.0
            } else {
                *apart <= 1.0
            },
            "{k}: {apart}"
        );
        assert!((model.median[k] - (k % 200) as f32 - 1.0).abs() <= 1.0);
    }
    for enough in [0.5, 1.0, 4.0, 100.0] {
        let mut soon = vec![0.0; pixels];
        model
            .distances(&picture, enough, &mut soon, &execution)
            .unwrap();
        for (soon, apart) in soon.iter().zip(&apart) {
            assert!(soon == apart || (*soon <= enough && apart <= soon));
        }
    }
}

#[test]
fn blocks_of_old_pixels_learn_as_single_ones_do() {
    let (size, mut numbers) = ((53, 7), Numbers::new(5));
    let pixels = size.0 * size.1;
    let mut model = Background::default();
    model.reset(size).unwrap();
    let mut plain = model.clone();
    let execution = Execution::default();
    for frame in 0..60 {
        let picture = greys(size, frame);
        let share = 0.03 * numbers.next();
        let seen: Vec<u8> = mask(size, share, frame ^ 1)
            .iter()
            .map(|set| 1 - set)
            .collect();
        let (away, adopt) = (
            mask(size, share, frame ^ 2),
            mask(size, share / 9.0, frame ^ 3),
        );
        model
            .learn(&picture, [&seen, &away, &adopt], &execution)
            .unwrap();
        plain.frame += 1;
        for at in (0..pixels).filter(|at| seen[*at] == 1 && (away[*at] == 0 || adopt[*at] == 1)) {
            let (x, y) = (at % size.0, at / size.0);
            let random = hashed(plain.frame, y as u64, (x / RATE) as u64);
            let sample = sample_of(picture[at]);
            let mut put = |slot: usize| plain.samples[slot * pixels + at] = sample;
            let age = usize::from(plain.age[at]);
            if plain.known[at] == 0 || adopt[at] == 1 {
                (0..SAMPLES).for_each(put);
                (plain.known[at], plain.age[at]) = (1, 1);
                continue;
            } else if age < SAMPLES {
                put(age);
                put((age + SAMPLES / 2) % SAMPLES);
            } else if (random % RATE as u64) as usize == x % RATE {
                put((random >> 32) as usize % SAMPLES);
            }
            plain.age[at] = plain.age[at].saturating_add(1);
        }
        assert_eq!(
            (&model.samples, &model.age),
            (&plain.samples, &plain.age),
            "{frame}"
        );
        assert_eq!(model.known, plain.known);
    }
}
