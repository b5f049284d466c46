//! Fewer layers that do the same to what is seen through them.
//!
//! A profile is cut by height into k slabs, and each becomes one layer with the slab's weight, the height
//! (sum w h^(5/3) / sum w)^(3/5) and the speed (sum w v^(5/3) / sum w)^(3/5), along the slab's mean wind: r0, the
//! isoplanatic angle and the coherence time, integrals of Cn2, Cn2 h^(5/3) and Cn2 v^(5/3), stay what they are
//! exactly, whatever the cuts. These lie where the mean of the shares of the first two grows by 1/k: the ground, with
//! most of the weight, and what is high, with most of the moment, get about as many layers each. A layer across a cut
//! is divided; one that fills slabs of its own stays one, and there are fewer.

use crate::atmosphere::Layer;

/// Heights that differ by less than this part are one layer's, divided between slabs and rounded.
const SAME: f64 = 1e-9;

/// `layers`, in any order, as `count` of them at most, or as they are if there are no more.
pub fn reduced(layers: &[Layer], count: usize) -> Vec<Layer> {
    let mut sorted: Vec<Layer> = layers.iter().copied().filter(|l| l.weight > 0.0).collect();
    sorted.sort_by(|a, b| a.height_m.total_cmp(&b.height_m));
    if sorted.len() <= count || count == 0 {
        return sorted;
    }
    let weights: f64 = sorted.iter().map(|layer| layer.weight).sum();
    let moments: f64 = sorted.iter().map(moment).sum();
    let share = |layer: &Layer| {
        let of_moment = if moments > 0.0 { moment(layer) / moments } else { 0.0 };
        (layer.weight / weights + of_moment) / if moments > 0.0 { 2.0 } else { 1.0 }
    };
    let step = 1.0 / count as f64;
    let mut slabs = vec![Vec::new(); count];
    let mut done = 0.0;
    for layer in &sorted {
        let (from, to) = (done, done + share(layer));
        done = to;
        for (k, slab) in slabs.iter_mut().enumerate() {
            let inside = to.min((k + 1) as f64 * step) - from.max(k as f64 * step);
            // Rounding leaves the last a little short of one.
            if inside > 1e-12 {
                slab.push(Layer { weight: layer.weight * inside / (to - from), ..*layer });
            }
        }
    }
    let mut few: Vec<Layer> = Vec::with_capacity(count);
    for slab in slabs.iter().filter(|slab| !slab.is_empty()) {
        let next = as_one(slab);
        match few.last_mut() {
            Some(last) if next.height_m - last.height_m <= SAME * next.height_m => {
                *last = as_one(&[*last, next]);
            }
            _ => few.push(next),
        }
    }
    few
}

fn moment(layer: &Layer) -> f64 {
    layer.weight * layer.height_m.powf(5.0 / 3.0)
}

fn as_one(slab: &[Layer]) -> Layer {
    let weight: f64 = slab.iter().map(|layer| layer.weight).sum();
    let mean = |of: &dyn Fn(&Layer) -> f64| {
        (slab.iter().map(|l| l.weight * of(l).powf(5.0 / 3.0)).sum::<f64>() / weight).powf(0.6)
    };
    let along = [0, 1].map(|axis| {
        slab.iter().map(|layer| layer.weight * layer.velocity_m_per_s()[axis]).sum::<f64>()
    });
    Layer {
        weight,
        height_m: mean(&|layer| layer.height_m),
        wind_speed_m_per_s: mean(&|layer| layer.wind_speed_m_per_s),
        wind_direction_deg: along[1].atan2(along[0]).to_degrees(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cn2::Profile;

    /// Integrals of Cn2, Cn2 h^(5/3) and Cn2 v^(5/3).
    fn integrals(layers: &[Layer]) -> [f64; 3] {
        let sum = |of: &dyn Fn(&Layer) -> f64| -> f64 {
            layers.iter().map(|layer| layer.weight * of(layer).powf(5.0 / 3.0)).sum()
        };
        [sum(&|_| 1.0), sum(&|layer| layer.height_m), sum(&|layer| layer.wind_speed_m_per_s)]
    }

    #[test]
    fn integrals_stay() {
        for profile in [Profile::HufnagelValley57, Profile::EsoMedian35, Profile::MaunaKea7] {
            let whole = profile.layers(12e3);
            for count in [1, 2, 3, 5, 6] {
                let few = reduced(&whole, count);
                assert!((1..=count).contains(&few.len()));
                for (found, expected) in integrals(&few).iter().zip(integrals(&whole)) {
                    assert!((found / expected - 1.0).abs() < 1e-9, "{profile:?} {count}");
                }
                assert!(few.windows(2).all(|pair| pair[0].height_m < pair[1].height_m));
            }
            assert_eq!(reduced(&whole, whole.len()), whole);
        }
    }

    #[test]
    fn all_at_the_ground_is_divided_by_weight() {
        let layer = |weight, direction| Layer {
            weight,
            height_m: 0.0,
            wind_speed_m_per_s: 10.0,
            wind_direction_deg: direction,
        };
        let few = reduced(&[layer(1.0, 0.0), layer(1.0, 90.0), layer(2.0, 90.0)], 1);
        assert_eq!((few.len(), few[0].weight, few[0].height_m), (1, 4.0, 0.0));
        assert!((few[0].wind_speed_m_per_s - 10.0).abs() < 1e-12);
        // Three parts to one.
        assert!((few[0].wind_direction_deg - 3f64.atan2(1.0).to_degrees()).abs() < 1e-12);
    }
}
