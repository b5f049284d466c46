//! The commands, one a file.

pub mod beam;
mod campaign;
pub mod centroids;
pub mod closed_loop;
pub mod config;
pub mod crosstalk;
pub mod endure;
pub mod faults;
pub mod frames;
pub mod gates;
pub mod link;
pub mod merge;
mod output;
pub mod power;
pub mod profile;
mod progress;
pub mod replay;
pub mod reproduce;
pub mod scale;
pub mod strehl;
pub mod theory;

use std::cmp::Ordering;

/// Values in the order in which they come, each once.
fn once<T: PartialEq>(values: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut all = Vec::new();
    for value in values {
        if !all.contains(&value) {
            all.push(value);
        }
    }
    all
}

/// Values of an argument by `order`, each once.
fn increasing<T: Copy + PartialEq>(values: &[T], order: fn(&T, &T) -> Ordering) -> Vec<T> {
    let mut values = values.to_vec();
    values.sort_unstable_by(order);
    values.dedup();
    values
}
