//! Sixteen `f32` at a time, by the instructions of a level.
//!
//! A value of a level's type exists only where this CPU has that level: all of them come from a token ([`Simd`]) that
//! `dispatch_lanes` alone makes, after it has looked. That is what makes the operations safe to call.
#![allow(clippy::needless_range_loop, reason = "lanes are counted")]

use std::ops::{Add, Div, Mul, Sub};

/// Elements in one value.
pub(crate) const LANES: usize = 16;

/// Sixteen `f32`. Minimum and maximum are `if a < b { a } else { b }` and `if a > b { a } else { b }`, so that a NaN
/// on the left gives the right side.
pub(crate) trait Floats:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Sixteen truths.
    type Mask: Copy;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// Where `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Where `self <= other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// `yes` where the mask is true, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Rounded towards zero; for values within 0..2^24.
    fn trunc(self) -> Self;
    /// Whether the mask is true in every lane.
    fn all(mask: Self::Mask) -> bool;
    /// Whether the mask is true in any lane.
    fn any(mask: Self::Mask) -> bool;
    /// The lane that stands first.
    fn first(self) -> f32;
    /// Lanes 0, 2, 4, .. and 1, 3, 5, .. of `self` followed by `next`.
    fn deinterleave(self, next: Self) -> (Self, Self);
    /// The inverse of [`Floats::deinterleave`]: `self` has the even lanes, `odd` the odd ones.
    fn interleave(self, odd: Self) -> (Self, Self);
    /// Write to all of `to`.
    fn put(self, to: &mut [f32; LANES]);
}

/// Sixteen elements were asked for where there are fewer.
#[cold]
fn beyond(len: usize, at: usize) -> ! {
    panic!("{LANES} elements at {at} of {len}")
}

/// `count` times sixteen elements of `row` from `first` on. A loop over `0..count` then needs no check of an index.
#[inline(always)]
pub(crate) fn blocks(row: &[f32], first: usize, count: usize) -> &[[f32; LANES]] {
    &row[first..].as_chunks::<LANES>().0[..count]
}

/// [`blocks`], to write.
#[inline(always)]
pub(crate) fn blocks_mut(row: &mut [f32], first: usize, count: usize) -> &mut [[f32; LANES]] {
    &mut row[first..].as_chunks_mut::<LANES>().0[..count]
}

/// The instructions of a level.
pub(crate) trait Simd: Copy {
    /// Its sixteen floats.
    type F: Floats;
    /// All of `from`.
    fn get(self, from: &[f32; LANES]) -> Self::F;
    /// `from[at..at + 16]`.
    #[inline(always)]
    fn load(self, from: &[f32], at: usize) -> Self::F {
        match from[at..].first_chunk::<LANES>() {
            Some(from) => self.get(from),
            None => beyond(from.len(), at),
        }
    }
    fn splat(self, value: f32) -> Self::F;
    /// `row * stride + column` and the element after it in `data`, per lane. `row` and `column` are whole numbers of
    /// at least 0; a place beyond the last pair gives the last pair.
    ///
    /// # Panics
    ///
    /// Panics if `data` has fewer than two elements or more than `i32::MAX`.
    fn pairs(
        self,
        data: &[f32],
        stride: usize,
        row: Self::F,
        column: Self::F,
    ) -> (Self::F, Self::F);
    /// Of the sixteen elements of `low` and then those of `high`, the one at `index`, per lane. `index` is a whole number
    /// within 0..32.
    fn lookup(self, low: Self::F, high: Self::F, index: Self::F) -> Self::F;
    /// 0, 1, .. 15.
    #[inline(always)]
    fn ramp(self) -> Self::F {
        self.load(
            &[
                0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0,
                15.0,
            ],
            0,
        )
    }
}

/// The place of the last pair of `data`.
#[inline(always)]
fn last_pair(data: &[f32]) -> u32 {
    assert!(data.len() >= 2 && data.len() <= i32::MAX as usize);
    (data.len() - 2) as u32
}

/// What every CPU has.
#[derive(Clone, Copy)]
pub(super) struct Plain;

/// Sixteen floats in an array, for the compiler to vectorise.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Array([f32; LANES]);

impl Array {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = [0.0; LANES];
        for lane in 0..LANES {
            out[lane] = f(self.0[lane], other.0[lane]);
        }
        Self(out)
    }

    #[inline(always)]
    fn test(self, other: Self, f: impl Fn(f32, f32) -> bool) -> [u32; LANES] {
        let mut out = [0; LANES];
        for lane in 0..LANES {
            out[lane] = if f(self.0[lane], other.0[lane]) {
                u32::MAX
            } else {
                0
            };
        }
        out
    }
}

macro_rules! array_operators {
    ($($name:ident $function:ident $sign:tt),+) => {$(
        impl $name for Array {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, |a, b| a $sign b)
            }
        }
    )+};
}
array_operators!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Floats for Array {
    type Mask = [u32; LANES];

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.zip(self, |a, _| a.sqrt())
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a < b)
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a <= b)
    }
    #[inline(always)]
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|lane| a[lane] & b[lane])
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        let mut out = [0.0; LANES];
        for lane in 0..LANES {
            let bits = (yes.0[lane].to_bits() & mask[lane]) | (no.0[lane].to_bits() & !mask[lane]);
            out[lane] = f32::from_bits(bits);
        }
        Self(out)
    }
    #[inline(always)]
    fn trunc(self) -> Self {
        self.zip(self, |a, _| (a as i32) as f32)
    }
    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        mask.iter().fold(u32::MAX, |all, lane| all & lane) != 0
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask.iter().fold(0, |any, lane| any | lane) != 0
    }
    #[inline(always)]
    fn first(self) -> f32 {
        self.0[0]
    }
    #[inline(always)]
    fn deinterleave(self, next: Self) -> (Self, Self) {
        let (mut even, mut odd) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES / 2 {
            even[lane] = self.0[2 * lane];
            odd[lane] = self.0[2 * lane + 1];
            even[LANES / 2 + lane] = next.0[2 * lane];
            odd[LANES / 2 + lane] = next.0[2 * lane + 1];
        }
        (Self(even), Self(odd))
    }
    #[inline(always)]
    fn interleave(self, odd: Self) -> (Self, Self) {
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES / 2 {
            first[2 * lane] = self.0[lane];
            first[2 * lane + 1] = odd.0[lane];
            second[2 * lane] = self.0[LANES / 2 + lane];
            second[2 * lane + 1] = odd.0[LANES / 2 + lane];
        }
        (Self(first), Self(second))
    }
    #[inline(always)]
    fn put(self, to: &mut [f32; LANES]) {
        *to = self.0;
    }
}

impl Simd for Plain {
    type F = Array;

    #[inline(always)]
    fn get(self, from: &[f32; LANES]) -> Array {
        Array(*from)
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Array {
        Array([value; LANES])
    }
    #[inline(always)]
    fn lookup(self, low: Array, high: Array, index: Array) -> Array {
        let mut out = [0.0; LANES];
        for lane in 0..LANES {
            let at = index.0[lane] as u32 as usize % (2 * LANES);
            out[lane] = if at < LANES {
                low.0[at]
            } else {
                high.0[at - LANES]
            };
        }
        Array(out)
    }
    #[inline(always)]
    fn pairs(self, data: &[f32], stride: usize, row: Array, column: Array) -> (Array, Array) {
        let last = last_pair(data);
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let at = (row.0[lane] as u32)
                .wrapping_mul(stride as u32)
                .wrapping_add(column.0[lane] as u32);
            let at = at.min(last) as usize;
            first[lane] = data[at];
            second[lane] = data[at + 1];
        }
        (Array(first), Array(second))
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Sub};

    use super::{Floats, LANES, Simd, last_pair};

    /// Exists only where AVX2 does.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx2(());

    /// Exists only where AVX-512 F and DQ do.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx512(());

    impl Avx2 {
        /// # Safety
        ///
        /// This CPU must have AVX2.
        pub(in crate::simd) unsafe fn new() -> Self {
            Self(())
        }
    }

    impl Avx512 {
        /// # Safety
        ///
        /// This CPU must have AVX-512 F and DQ.
        pub(in crate::simd) unsafe fn new() -> Self {
            Self(())
        }
    }

    /// Sixteen floats; made by [`Avx2`] only.
    #[derive(Clone, Copy)]
    pub(crate) struct F256(__m256, __m256);

    /// Sixteen floats; made by [`Avx512`] only.
    #[derive(Clone, Copy)]
    pub(crate) struct F512(__m512);

    macro_rules! operators {
        ($($name:ident $function:ident $wide:ident $half:ident),+) => {$(
            impl $name for F512 {
                type Output = Self;
                #[inline(always)]
                fn $function(self, other: Self) -> Self {
                    // SAFETY: the CPU has AVX-512 F, for `self` exists.
                    Self(unsafe { $wide(self.0, other.0) })
                }
            }
            impl $name for F256 {
                type Output = Self;
                #[inline(always)]
                fn $function(self, other: Self) -> Self {
                    // SAFETY: the CPU has AVX2, for `self` exists.
                    unsafe { Self($half(self.0, other.0), $half(self.1, other.1)) }
                }
            }
        )+};
    }
    operators!(
        Add add _mm512_add_ps _mm256_add_ps,
        Sub sub _mm512_sub_ps _mm256_sub_ps,
        Mul mul _mm512_mul_ps _mm256_mul_ps,
        Div div _mm512_div_ps _mm256_div_ps
    );

    impl Floats for F512 {
        type Mask = __mmask16;

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: the CPU has AVX-512 F, for `self` exists.
            Self(unsafe { _mm512_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
        }
        #[inline(always)]
        fn le(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) }
        }
        #[inline(always)]
        fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
            a & b
        }
        #[inline(always)]
        fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_mask_blend_ps(mask, no.0, yes.0) })
        }
        #[inline(always)]
        fn trunc(self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_cvtepi32_ps(_mm512_cvttps_epi32(self.0)) })
        }
        #[inline(always)]
        fn all(mask: Self::Mask) -> bool {
            mask == __mmask16::MAX
        }
        #[inline(always)]
        fn any(mask: Self::Mask) -> bool {
            mask != 0
        }
        #[inline(always)]
        fn first(self) -> f32 {
            // SAFETY: as above.
            unsafe { _mm512_cvtss_f32(self.0) }
        }
        #[inline(always)]
        fn deinterleave(self, next: Self) -> (Self, Self) {
            // SAFETY: as above.
            unsafe {
                let even =
                    _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
                let odd =
                    _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
                (
                    Self(_mm512_permutex2var_ps(self.0, even, next.0)),
                    Self(_mm512_permutex2var_ps(self.0, odd, next.0)),
                )
            }
        }
        #[inline(always)]
        fn interleave(self, odd: Self) -> (Self, Self) {
            // SAFETY: as above.
            unsafe {
                let low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
                let high =
                    _mm512_setr_epi32(8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
                (
                    Self(_mm512_permutex2var_ps(self.0, low, odd.0)),
                    Self(_mm512_permutex2var_ps(self.0, high, odd.0)),
                )
            }
        }
        #[inline(always)]
        fn put(self, to: &mut [f32; LANES]) {
            // SAFETY: as above; an unaligned store over the whole of an array of 16 elements.
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
        }
    }

    impl Simd for Avx512 {
        type F = F512;

        #[inline(always)]
        fn get(self, from: &[f32; LANES]) -> F512 {
            // SAFETY: the CPU has AVX-512 F, for `self` exists; an unaligned load of an array of 16 elements.
            F512(unsafe { _mm512_loadu_ps(from.as_ptr()) })
        }
        #[inline(always)]
        fn splat(self, value: f32) -> F512 {
            // SAFETY: the CPU has AVX-512 F, for `self` exists.
            F512(unsafe { _mm512_set1_ps(value) })
        }
        #[inline(always)]
        fn lookup(self, low: F512, high: F512, index: F512) -> F512 {
            // SAFETY: the CPU has AVX-512 F, for `self` exists.
            F512(unsafe { _mm512_permutex2var_ps(low.0, _mm512_cvttps_epi32(index.0), high.0) })
        }
        #[inline(always)]
        fn pairs(self, data: &[f32], stride: usize, row: F512, column: F512) -> (F512, F512) {
            let last = last_pair(data);
            // SAFETY: the CPU has AVX-512 F and DQ, for `self` exists. Every place read is at most `last`, so that the
            // eight bytes there are inside `data`; `last` fits an i32.
            unsafe {
                let row = _mm512_mullo_epi32(
                    _mm512_cvttps_epi32(row.0),
                    _mm512_set1_epi32(stride as i32),
                );
                let places = _mm512_add_epi32(row, _mm512_cvttps_epi32(column.0));
                let places = _mm512_min_epu32(places, _mm512_set1_epi32(last as i32));
                let base = data.as_ptr().cast();
                let low = _mm512_i32gather_epi64::<4>(_mm512_castsi512_si256(places), base);
                let high =
                    _mm512_i32gather_epi64::<4>(_mm512_extracti32x8_epi32::<1>(places), base);
                let even =
                    _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
                let odd =
                    _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
                let first = _mm512_permutex2var_epi32(low, even, high);
                let second = _mm512_permutex2var_epi32(low, odd, high);
                (
                    F512(_mm512_castsi512_ps(first)),
                    F512(_mm512_castsi512_ps(second)),
                )
            }
        }
    }

    impl Floats for F256 {
        type Mask = (__m256, __m256);

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe {
                Self(
                    _mm256_min_ps(self.0, other.0),
                    _mm256_min_ps(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            unsafe {
                Self(
                    _mm256_max_ps(self.0, other.0),
                    _mm256_max_ps(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: as above.
            unsafe { Self(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)) }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe {
                (
                    _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0),
                    _mm256_cmp_ps::<_CMP_LT_OQ>(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn le(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe {
                (
                    _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0),
                    _mm256_cmp_ps::<_CMP_LE_OQ>(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
            // SAFETY: a mask comes from a comparison of values, which exist only where AVX2 does.
            unsafe { (_mm256_and_ps(a.0, b.0), _mm256_and_ps(a.1, b.1)) }
        }
        #[inline(always)]
        fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
            // SAFETY: as above.
            unsafe {
                Self(
                    _mm256_blendv_ps(no.0, yes.0, mask.0),
                    _mm256_blendv_ps(no.1, yes.1, mask.1),
                )
            }
        }
        #[inline(always)]
        fn trunc(self) -> Self {
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe {
                Self(
                    _mm256_cvtepi32_ps(_mm256_cvttps_epi32(self.0)),
                    _mm256_cvtepi32_ps(_mm256_cvttps_epi32(self.1)),
                )
            }
        }
        #[inline(always)]
        fn all(mask: Self::Mask) -> bool {
            // SAFETY: as for `both`.
            unsafe { _mm256_movemask_ps(_mm256_and_ps(mask.0, mask.1)) == 0xff }
        }
        #[inline(always)]
        fn any(mask: Self::Mask) -> bool {
            // SAFETY: as for `both`.
            unsafe { _mm256_movemask_ps(_mm256_or_ps(mask.0, mask.1)) != 0 }
        }
        #[inline(always)]
        fn first(self) -> f32 {
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe { _mm256_cvtss_f32(self.0) }
        }
        #[inline(always)]
        fn deinterleave(self, next: Self) -> (Self, Self) {
            /// The even (0x88) or odd (0xdd) elements of two registers.
            #[inline(always)]
            unsafe fn half<const PICK: i32>(a: __m256, b: __m256) -> __m256 {
                // SAFETY: the caller has AVX2.
                unsafe {
                    let mixed = _mm256_castps_pd(_mm256_shuffle_ps::<PICK>(a, b));
                    _mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(mixed))
                }
            }
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe {
                (
                    Self(half::<0x88>(self.0, self.1), half::<0x88>(next.0, next.1)),
                    Self(half::<0xdd>(self.0, self.1), half::<0xdd>(next.0, next.1)),
                )
            }
        }
        #[inline(always)]
        fn interleave(self, odd: Self) -> (Self, Self) {
            /// The elements of two registers in turn.
            #[inline(always)]
            unsafe fn zip(even: __m256, odd: __m256) -> F256 {
                // SAFETY: the caller has AVX2.
                unsafe {
                    let (low, high) =
                        (_mm256_unpacklo_ps(even, odd), _mm256_unpackhi_ps(even, odd));
                    F256(
                        _mm256_permute2f128_ps::<0x20>(low, high),
                        _mm256_permute2f128_ps::<0x31>(low, high),
                    )
                }
            }
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe { (zip(self.0, odd.0), zip(self.1, odd.1)) }
        }
        #[inline(always)]
        fn put(self, to: &mut [f32; LANES]) {
            // SAFETY: as above; two unaligned stores that together cover an array of 16 elements.
            unsafe {
                _mm256_storeu_ps(to.as_mut_ptr(), self.0);
                _mm256_storeu_ps(to.as_mut_ptr().add(8), self.1);
            }
        }
    }

    impl Simd for Avx2 {
        type F = F256;

        #[inline(always)]
        fn get(self, from: &[f32; LANES]) -> F256 {
            // SAFETY: the CPU has AVX2, for `self` exists; two unaligned loads inside an array of 16 elements.
            unsafe {
                F256(
                    _mm256_loadu_ps(from.as_ptr()),
                    _mm256_loadu_ps(from.as_ptr().add(8)),
                )
            }
        }
        #[inline(always)]
        fn splat(self, value: f32) -> F256 {
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe { F256(_mm256_set1_ps(value), _mm256_set1_ps(value)) }
        }
        #[inline(always)]
        fn lookup(self, low: F256, high: F256, index: F256) -> F256 {
            /// The elements of four registers of eight at the places in `index`, modulo 32.
            #[inline(always)]
            unsafe fn pick(from: [__m256; 4], index: __m256i) -> __m256 {
                // SAFETY: the caller has AVX2.
                unsafe {
                    let [a, b, c, d] = [
                        _mm256_permutevar8x32_ps(from[0], index),
                        _mm256_permutevar8x32_ps(from[1], index),
                        _mm256_permutevar8x32_ps(from[2], index),
                        _mm256_permutevar8x32_ps(from[3], index),
                    ];
                    // The bits worth 8 and 16, as the signs that a blend looks at.
                    let eight = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index));
                    let sixteen = _mm256_castsi256_ps(_mm256_slli_epi32::<27>(index));
                    let (lower, upper) =
                        (_mm256_blendv_ps(a, b, eight), _mm256_blendv_ps(c, d, eight));
                    _mm256_blendv_ps(lower, upper, sixteen)
                }
            }
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe {
                let from = [low.0, low.1, high.0, high.1];
                F256(
                    pick(from, _mm256_cvttps_epi32(index.0)),
                    pick(from, _mm256_cvttps_epi32(index.1)),
                )
            }
        }
        #[inline(always)]
        fn pairs(self, data: &[f32], stride: usize, row: F256, column: F256) -> (F256, F256) {
            let last = last_pair(data);
            // SAFETY: the CPU has AVX2, for `self` exists. Every place read is at most `last`, so that it and the one
            // after are inside `data`; `last` fits an i32.
            unsafe {
                let limit = _mm256_set1_epi32(last as i32);
                let stride = _mm256_set1_epi32(stride as i32);
                let places = |row, column| {
                    let row = _mm256_mullo_epi32(_mm256_cvttps_epi32(row), stride);
                    _mm256_min_epu32(_mm256_add_epi32(row, _mm256_cvttps_epi32(column)), limit)
                };
                let (low, high) = (places(row.0, column.0), places(row.1, column.1));
                let (base, after) = (data.as_ptr(), data.as_ptr().add(1));
                (
                    F256(
                        _mm256_i32gather_ps::<4>(base, low),
                        _mm256_i32gather_ps::<4>(base, high),
                    ),
                    F256(
                        _mm256_i32gather_ps::<4>(after, low),
                        _mm256_i32gather_ps::<4>(after, high),
                    ),
                )
            }
        }
    }
}
