//! `rsflow._core`: numpy arrays in, lk-core, numpy arrays out. No algorithm lives here.
//!
//! Every call releases the GIL while it computes, and long ones look for signals; see `interrupt`.

mod corners;
mod errors;
mod flow;
mod frames;
mod grid;
mod ink;
mod interrupt;
mod outputs;
mod plane;
mod points;
mod segmenter;
mod shared;
mod shift;
mod states;
mod things;
mod tracker;
mod tracking;

use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Set the number of threads of all calls.
///
/// Parameters
/// ----------
/// threads : int
///     At most 1024; 0 means one for each CPU. Results do not depend on it. The threads of another number are let go
///     once the calls end that use them.
///
/// Raises
/// ------
/// OptionError
///     If it is negative or more than 1024.
///
/// Examples
/// --------
/// >>> import rsflow
/// >>> before = rsflow.get_num_threads()
/// >>> rsflow.set_num_threads(2)
/// >>> rsflow.get_num_threads()
/// 2
/// >>> rsflow.set_num_threads(before)
#[pyfunction]
fn set_num_threads(threads: isize) -> PyResult<()> {
    let threads = usize::try_from(threads).map_err(|_| {
        errors::to_python(&lk_core::Error::option(
            "threads",
            threads,
            format!("1 to {}, or 0 for one for each CPU", lk_core::MAX_THREADS),
        ))
    })?;
    lk_core::set_num_threads(threads).map_err(|error| errors::to_python(&error))
}

/// The number of threads of all calls.
///
/// Returns
/// -------
/// int
///
/// Examples
/// --------
/// >>> import rsflow
/// >>> rsflow.get_num_threads() >= 1
/// True
#[pyfunction]
fn get_num_threads() -> usize {
    lk_core::num_threads()
}

/// Let the calls of this thread keep to it, unless there are more threads than so many callers that work at the same time.
#[pyfunction]
fn share_threads(callers: usize) {
    interrupt::share_threads(callers);
}

/// What this build is and which instructions it uses here.
///
/// Returns
/// -------
/// dict
///     `version`; `cpu_level`, the instructions that calls use, and `cpu_levels`, those that this processor has;
///     `threads`; `profile`, "release" or "debug"; `target`, architecture and system.
///
/// Examples
/// --------
/// >>> import rsflow
/// >>> info = rsflow.build_info()
/// >>> info["version"] == rsflow.__version__, info["cpu_level"] in info["cpu_levels"]
/// (True, True)
#[pyfunction]
fn build_info(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let info = PyDict::new(py);
    info.set_item("version", env!("CARGO_PKG_VERSION"))?;
    info.set_item("cpu_level", {
        let level =
            lk_core::SimdLevel::of_environment().map_err(|error| errors::to_python(&error))?;
        level.name()
    })?;
    let levels: Vec<_> = lk_core::SimdLevel::available()
        .into_iter()
        .map(lk_core::SimdLevel::name)
        .collect();
    info.set_item("cpu_levels", levels)?;
    info.set_item("threads", lk_core::num_threads())?;
    info.set_item(
        "profile",
        if cfg!(debug_assertions) {
            "debug"
        } else {
            "release"
        },
    )?;
    info.set_item(
        "target",
        format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
    )?;
    Ok(info)
}

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    errors::keep_panics();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<flow::DenseFlow>()?;
    module.add_function(wrap_pyfunction!(set_num_threads, module)?)?;
    module.add_function(wrap_pyfunction!(get_num_threads, module)?)?;
    module.add_function(wrap_pyfunction!(share_threads, module)?)?;
    module.add_function(wrap_pyfunction!(build_info, module)?)?;
    tracking::register(module)?;
    grid::register(module)?;
    module.add_function(wrap_pyfunction!(corners::detect_corners, module)?)?;
    module.add_class::<tracker::PyPointTracker>()?;
    plane::register(module)?;
    segmenter::register(module)?;
    things::register(module)?;
    ink::register(module)?;
    module.add_function(wrap_pyfunction!(shift::estimate_shift, module)?)?;
    module.add_function(wrap_pyfunction!(shift::shift_statuses, module)?)?;
    Ok(())
}
