// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// The Python module posfet_core.scan_path: what is computed for every scan and at the end of every block.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <memory>
#include <optional>

#include "posfet_core/assignment.hpp"
#include "posfet_core/detection.hpp"
#include "posfet_core/force_estimate.hpp"
#include "posfet_core/neighbour_estimate.hpp"
#include "posfet_core/slip.hpp"
#include "posfet_core/tracker.hpp"
#include "python_arrays.hpp"
#include "python_bindings.hpp"
#include "python_contacts.hpp"

namespace posfet {

namespace {

/// A force estimate with the arrays that it refers to.
class PythonForceEstimate {
public:
  PythonForceEstimate(KeptValues force, KeptValues variance, Flags saturated, Flags unlisted, Flags interpolated,
                      std::optional<Values> correlated_error)
      : force_(std::move(force)),
        variance_(std::move(variance)),
        saturated_(std::move(saturated)),
        unlisted_(std::move(unlisted)),
        interpolated_(std::move(interpolated)),
        correlated_error_(std::move(correlated_error)) {
    const Taxel count = at_least_one(force_.size());
    estimate_.force = values_of(force_, count, "force");
    estimate_.variance = values_of(variance_, count, "variance");
    estimate_.saturated = flags_of(saturated_, count, "saturated");
    estimate_.unlisted = flags_of(unlisted_, count, "unlisted");
    estimate_.interpolated = flags_of(interpolated_, count, "interpolated");
    if (correlated_error_) {
      estimate_.correlated_error = values_of(*correlated_error_, count, "correlated_error");
      estimate_.causes = static_cast<std::size_t>(correlated_error_->size() / count);
    }
  }

  /// The estimate; throws ValueError where its array has not as many taxels.
  const ForceEstimate& of(Taxel taxels) const {
    require_taxels(force_, taxels, "force");
    return estimate_;
  }

private:
  KeptValues force_;
  KeptValues variance_;
  Flags saturated_;
  Flags unlisted_;
  Flags interpolated_;
  std::optional<Values> correlated_error_;
  ForceEstimate estimate_;
};

py::tuple measure(ContactFinder& finder, const PythonForceEstimate& taxels, const py::sequence& before) {
  const Vector<Region> regions = regions_from(before);
  KnownRegions known;
  for (const Region& region : regions) {
    known.push_back(&region);
  }
  return tuple_of(finder.measure(taxels.of(finder.grid().taxels()), known));
}

py::list regions(const ContactFinder& finder) {
  py::list found;
  for (const Footprint& footprint : finder.regions()) {
    found.append(array_of(footprint.region));
  }
  return found;
}

py::list patches(const ContactFinder& finder) {
  py::list found;
  for (const Taxels& members : finder.patches()) {
    found.append(array_of(members));
  }
  return found;
}

void bind_detection(const py::module_& module) {
  py::class_<Layout>(module, "Layout", "Size of an array.")
      .def(py::init([](Taxel rows, Taxel cols, double pitch_x, double pitch_y, double taxel_area) {
             return Layout{rows, cols, pitch_x, pitch_y, taxel_area};
           }),
           py::arg("rows"), py::arg("cols"), py::arg("pitch_x"), py::arg("pitch_y"), py::arg("taxel_area"));

  py::class_<PythonForceEstimate>(module, "ForceEstimate", "Forces of all taxels with their uncertainty.")
      .def(py::init<KeptValues, KeptValues, Flags, Flags, Flags, std::optional<Values>>(), py::arg("force").noconvert(),
           py::arg("variance").noconvert(), py::arg("saturated") = py::none(), py::arg("unlisted") = py::none(),
           py::arg("interpolated") = py::none(), py::arg("correlated_error") = py::none());

  py::class_<ContactFinder, std::shared_ptr<ContactFinder>>(module, "ContactFinder",
                                                            "Detects contacts scan by scan, with hysteresis.")
      .def(py::init([](const Layout& layout, double spread, double enter, double release) {
             return std::make_unique<ContactFinder>(layout, spread, ContactThresholds{enter, release});
           }),
           py::arg("layout"), py::arg("spread"), py::arg("enter"), py::arg("release"))
      .def(
          "change_thresholds",
          [](ContactFinder& finder, double enter, double release) { finder.thresholds().set({enter, release}); },
          py::arg("enter"), py::arg("release"), "Use other thresholds [N] from the next `update_thresholds` on.")
      .def(
          "update_thresholds",
          [](ContactFinder& finder, const Values& force, const Values& variance, const Flags& usable, double duration) {
            const Taxel taxels = finder.grid().taxels();
            finder.thresholds().update(values_of(force, taxels, "force"), values_of(variance, taxels, "variance"),
                                       flags_of(usable, taxels, "usable"), duration);
          },
          py::arg("force"), py::arg("variance"), py::arg("usable") = py::none(), py::arg("duration") = kRecentTime,
          "Set the thresholds according to the uncertainty of the forces.")
      .def(
          "find",
          [](ContactFinder& finder, const Values& force) {
            return finder.find(values_of(force, finder.grid().taxels(), "force"));
          },
          py::arg("force"), "Find the regions in contact in the forces of a scan [N]; return their number.")
      .def("measure", &measure, py::arg("taxels"), py::arg("before") = py::tuple(),
           "Measure the regions that `find` found, and separate contacts that share one.")
      .def(
          "dilated",
          [](const ContactFinder& finder, const py::array_t<bool, py::array::c_style | py::array::forcecast>& taxels,
             Taxel distance) {
            return array_of(dilated(finder.grid(), mask_of(taxels, finder.grid().taxels(), "taxels"), distance));
          },
          py::arg("taxels"), py::arg("distance"), "Return a mask dilated by a distance in taxels.")
      .def_property_readonly(
          "touched", [](const ContactFinder& finder) { return array_of(finder.thresholds().touched_since_update()); },
          "Taxels in contact in any scan since the last `update_thresholds`, or being released.")
      .def_property_readonly("regions", &regions, "Taxels of each region that `find` found last.")
      .def_property_readonly("patches", &patches,
                             "Members of each region that was measured last, the ring around it included.");
}

void bind_tracking(py::module_& module) {
  py::class_<ContactTracker, std::shared_ptr<ContactTracker>>(module, "ContactTracker",
                                                              "Follows contacts from scan to scan.")
      .def(py::init([](double gate, double smoothing, double start_speed, double stop_speed, double pitch,
                       double threshold, double noise, TrackId first_id) {
             return std::make_unique<ContactTracker>(
                 TrackerSettings{gate, smoothing, start_speed, stop_speed, pitch, threshold, noise}, first_id);
           }),
           py::kw_only(), py::arg("gate"), py::arg("smoothing"), py::arg("start_speed"), py::arg("stop_speed"),
           py::arg("pitch"), py::arg("threshold"), py::arg("noise"), py::arg("first_id"))
      .def_property_readonly("next_id", &ContactTracker::next_id, "Id of the next contact.")
      .def_property_readonly("idle", &ContactTracker::idle,
                             "Whether there is no contact that could continue or be released.")
      .def(
          "update",
          [](ContactTracker& tracker, const py::sequence& regions, double step) {
            return tuple_of(tracker.update(regions_from(regions), positive(step, "step")));
          },
          py::arg("regions"), py::arg("step"), "Associate the regions of a scan with the contacts of the scan before.")
      .def(
          "follow",
          [](ContactTracker& tracker, ContactFinder& finder, const PythonForceEstimate& taxels, double step) {
            return tuple_of(tracker.follow(finder, taxels.of(finder.grid().taxels()), positive(step, "step")));
          },
          py::arg("finder"), py::arg("taxels"), py::arg("step"),
          "Measure the regions that a finder found in a scan, and update the contacts with them.");
  module.def("minimum_cost_assignment", &minimum_cost_assignment, py::arg("costs"), py::arg("unassigned_cost"),
             "Return the pairs of row and column with the least total cost.");
  module.attr("LAST_ID") = kLastId;
}

py::dict update_motions(DynamicChannel& channel, const ContactTracker& tracker, const Values& force, double step) {
  return to_python(
      channel.update(tracker.contacts(), values_of(force, channel.taxels(), "force"), positive(step, "step")));
}

void bind_slip(const py::module_& module) {
  py::class_<DynamicChannel, std::shared_ptr<DynamicChannel>>(module, "DynamicChannel",
                                                              "High-passed force of every taxel.")
      .def(py::init<const Layout&, double>(), py::arg("layout"), py::arg("noise"))
      .def("pause", &DynamicChannel::pause, "Stop the filter: the scans from here on are not passed to `advance`.")
      .def(
          "advance",
          [](DynamicChannel& channel, const Values& change, double step) {
            channel.advance(values_of(change, channel.taxels(), "change"), positive(step, "step"));
          },
          py::arg("change"), py::arg("step"), "Filter the force changes of a scan [N] over a step [s].")
      .def("update_power", &DynamicChannel::update_power, py::arg("step"),
           "Update the mean square of each taxel's high-passed force over a step [s].")
      .def("update", &update_motions, py::arg("tracker"), py::arg("force"), py::arg("step"),
           "Update vibration and slip of each contact that a tracker follows.")
      .def_property_readonly(
          "high_passed",
          [](const py::object& self) { return view_of(self.cast<const DynamicChannel&>().high_passed(), self); },
          "High-passed force of each taxel [N]; read-only.")
      .def_property_readonly(
          "power", [](const py::object& self) { return view_of(self.cast<const DynamicChannel&>().power(), self); },
          "Mean square of the high-passed force of each taxel [N2]; read-only.");
  module.attr("CORNER_FREQUENCY") = kCornerFrequency;
  module.attr("POWER_TIME_CONSTANT") = kPowerTimeConstant;
  module.attr("SLIP_SPEED") = kSlipSpeed;
  module.attr("SLIP_END_SPEED") = kSlipEndSpeed;
}

/// What a function of neighbour_estimate.hpp gives for each of some taxels.
template <typename Estimate>
py::array_t<double> estimates(Estimate estimate, const Grid& grid, const Values& force, const Tested& unknown,
                              const Indices& wanted) {
  const double* forces = values_of(force, grid.taxels(), "force");
  require_taxels(unknown, grid.taxels(), "unknown");
  py::array_t<double> found(wanted.size());
  for (py::ssize_t index = 0; index < wanted.size(); ++index) {
    const Taxel taxel = wanted.data()[index];
    if (taxel < 0 || taxel >= grid.taxels()) {
      throw py::index_error("wanted must have indices of taxels");
    }
    found.mutable_data()[index] = estimate(forces, unknown.data(), taxel);
  }
  return found;
}

void bind_neighbours(const py::module_& module) {
  py::class_<Grid>(module, "NeighbourInterpolation", "What the neighbours of a taxel predict for its force.")
      .def(py::init<const Layout&>(), py::arg("layout"))
      .def(
          "interpolate",
          [](const Grid& grid, const Values& force, const Tested& unknown, const Indices& wanted, double floor,
             double most_x, double most_y) {
            const InterpolationLimits limits{floor, most_x, most_y};
            py::array_t<double> deviation(wanted.size());
            double* next = deviation.mutable_data();
            const auto estimate = [&](const double* forces, const bool* hidden, Taxel taxel) {
              const NeighbourEstimate found = neighbour_interpolation(grid, forces, hidden, taxel, limits);
              *next++ = found.deviation;
              return found.force;
            };
            const py::array_t<double> found = estimates(estimate, grid, force, unknown, wanted);
            return py::make_tuple(found, deviation);
          },
          py::arg("force"), py::arg("unknown"), py::arg("wanted"), py::arg("floor"), py::arg("most_x"),
          py::arg("most_y"),
          "Return the forces [N] of the wanted taxels as their neighbours predict them, and their deviations [N].")
      .def(
          "lower_bound",
          [](const Grid& grid, const Values& force, const Tested& unknown, const Indices& wanted, double floor) {
            const std::vector<double> floors(static_cast<std::size_t>(grid.taxels()), floor);
            const auto estimate = [&](const double* forces, const bool* hidden, Taxel taxel) {
              return neighbour_lower_bound(grid, forces, hidden, taxel, floors.data());
            };
            return estimates(estimate, grid, force, unknown, wanted);
          },
          py::arg("force"), py::arg("unknown"), py::arg("wanted"), py::arg("floor"),
          "Return the smallest force [N] that any square of each wanted taxel predicts.")
      .def(
          "max_neighbour",
          [](const Grid& grid, const Values& level) {
            const double* levels = values_of(level, grid.taxels(), "level");
            py::array_t<double> found(grid.taxels());
            for (Taxel taxel = 0; taxel < grid.taxels(); ++taxel) {
              found.mutable_data()[taxel] = largest_neighbour(grid, levels, taxel);
            }
            return found;
          },
          py::arg("level"), "Return the largest value among the eight neighbours of each taxel.");
}

}  // namespace

}  // namespace posfet

PYBIND11_MODULE(scan_path, module) {
  module.doc() = "What is computed for every scan and at the end of every block, compiled.";
  posfet::bind_detection(module);
  posfet::bind_tracking(module);
  posfet::bind_slip(module);
  posfet::bind_neighbours(module);
  posfet::bind_scan_parts(module);
  posfet::bind_estimation(module);
  posfet::bind_estimation_parts(module);
  posfet::bind_hum(module);
  posfet::bind_faults(module);
  posfet::bind_scan_path(module);
  posfet::bind_blocks(module);
  posfet::bind_sink(module);
  module.attr("INTERPOLATION_UNCERTAINTY") = posfet::kInterpolationUncertainty;
  module.attr("ENTER_DEVIATIONS") = posfet::kEnterDeviations;
}
