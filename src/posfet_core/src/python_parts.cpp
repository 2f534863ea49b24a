// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "posfet_core/bursts.hpp"
#include "posfet_core/count_history.hpp"
#include "posfet_core/crosstalk.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/leaky_response.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/scan_clock.hpp"
#include "posfet_core/skin_response.hpp"
#include "posfet_core/thermometers.hpp"
#include "python_arrays.hpp"
#include "python_bindings.hpp"
#include "python_scan.hpp"

namespace posfet {

namespace {

using Temperatures = py::array_t<float, py::array::c_style | py::array::forcecast>;

py::tuple counts_of(const ScanClock& clock) {
  const ScanCounts& counts = clock.counts();
  return py::make_tuple(counts.accepted, counts.layout_mismatch, counts.repeated, counts.late, counts.adc_fault,
                        counts.implausible, counts.bursts, counts.missed, counts.resets, counts.time_jumps,
                        counts.gaps);
}

void bind_clock(const py::module_& module) {
  py::class_<ScanClock, std::shared_ptr<ScanClock>>(module, "ScanClock", "Admits scans one by one.")
      .def(py::init<std::uint64_t, std::size_t, double, double>(), py::arg("layout_id"), py::arg("taxels"),
           py::arg("leak_time_constant"), py::arg("scan_rate"))
      .def(
          "fits", [](ScanClock& clock, const py::object& scan) { return clock.fits(PythonScan(scan).scan()); },
          py::arg("scan"), "Return whether a scan has the layout of this sensor; count it otherwise.")
      .def(
          "is_new", [](ScanClock& clock, const py::object& scan) { return clock.is_new(PythonScan(scan).scan()); },
          py::arg("scan"), "Return whether a scan that fits is neither duplicate nor late; count it otherwise.")
      .def(
          "is_sound", [](ScanClock& clock, const py::object& scan) { return clock.is_sound(PythonScan(scan).scan()); },
          py::arg("scan"), "Return whether the board reports no ADC fault; count it otherwise.")
      .def(
          "refuse", [](ScanClock& clock, const py::object& scan) { clock.refuse(PythonScan(scan).scan()); },
          py::arg("scan"), "Note a scan that is new, and refused for its content: it is not missing.")
      .def(
          "admit", [](ScanClock& clock, const py::object& scan) { clock.admit(PythonScan(scan).scan()); },
          py::arg("scan"), "Accept a scan that fits, is new and sound; set the interval before it.")
      .def_property_readonly("count_values", &counts_of, "The numbers of `ScanCounts`, in its order.")
      .def_property_readonly("step", &ScanClock::step, "Interval before the scan [s], > 0.")
      .def_property_readonly("interrupted", &ScanClock::interrupted,
                             "Whether the interval is unknown, or too long to track the force.")
      .def_property_readonly("close", &ScanClock::close,
                             "Whether at most a few scans were lost or refused since the one before.")
      .def_property_readonly("suspect", &ScanClock::suspect,
                             "Whether the interval was derived for lack of a valid device time.")
      .def_property_readonly("period", &ScanClock::period, "Estimated period of the scans [s].");
}

void bind_crosstalk(const py::module_& module) {
  py::class_<CrosstalkCompensator, std::shared_ptr<CrosstalkCompensator>>(module, "CrosstalkCompensator",
                                                                          "Compensates the crosstalk of one array.")
      .def(py::init<const Layout&, double>(), py::arg("layout"), py::arg("share"))
      .def_property_readonly("present", &CrosstalkCompensator::present, "Whether there is crosstalk to compensate.")
      .def(
          "apply",
          [](CrosstalkCompensator& compensator, const Values& signal) {
            const auto taxels = static_cast<Taxel>(compensator.taxels());
            const double* values = values_of(signal, taxels, "signal");
            py::array_t<double> compensated(taxels);
            std::copy(values, values + taxels, compensated.mutable_data());
            compensator.apply(compensated.mutable_data());
            return compensated;
          },
          py::arg("signal"), "Return the signals with the crosstalk compensated.");
}

py::tuple contradicts(const SkinResponse& skin, const Values& force, const Values& variance, const Tested& sound,
                      double certainty, bool one_sided) {
  const Taxel taxels = skin.grid().taxels();
  const double* forces = values_of(force, taxels, "force");
  const double* variances = values_of(variance, taxels, "variance");
  require_taxels(sound, taxels, "sound");
  py::array_t<bool> contradicted(taxels);
  py::array_t<bool> testable(taxels);
  for (Taxel taxel = 0; taxel < taxels; ++taxel) {
    const SkinResponse::Finding found = skin.test(taxel, forces, variances, sound.data(), certainty, one_sided);
    contradicted.mutable_data()[taxel] = found.contradicted;
    testable.mutable_data()[taxel] = found.testable;
  }
  return py::make_tuple(contradicted, testable);
}

void bind_bursts(const py::module_& module) {
  py::class_<SkinResponse>(module, "SkinResponse", "Tests whether neighbours feel what they must of a touch.")
      .def(py::init<const Layout&, double, double>(), py::arg("layout"), py::arg("share_x"), py::arg("share_y"))
      .def("contradicts", &contradicts, py::arg("force"), py::arg("variance"), py::arg("sound"), py::arg("certainty"),
           py::arg("one_sided") = false, "Return where the neighbours contradict a touch, and where they could.");

  py::class_<BurstDetector, std::shared_ptr<BurstDetector>>(module, "BurstDetector",
                                                            "Finds the scans with a burst, scan by scan.")
      .def(py::init<const SkinResponse&, double, double, double>(), py::arg("skin"), py::arg("least"),
           py::arg("variance"), py::arg("charge_per_newton"))
      .def(
          "set_usual_change",
          [](BurstDetector& detector, const Values& change) {
            detector.set_usual_change(values_of(change, detector.taxels(), "change"));
          },
          py::arg("change"), "Set the median difference of two changes of each taxel [N].")
      .def(
          "is_burst",
          [](BurstDetector& detector, const Values& charge, const py::int_& sequence, const Tested& faulty) {
            require_taxels(faulty, detector.taxels(), "faulty");
            return detector.is_burst(values_of(charge, detector.taxels(), "charge"), unsigned_of(sequence),
                                     faulty.data());
          },
          py::arg("charge"), py::arg("sequence"), py::arg("faulty"),
          "Return whether a scan has a burst, and keep its charges if not.");
  module.attr("MOST_IN_A_ROW") = kMostInARow;
}

/// An array of the shape of another one.
py::array_t<double> like(const Values& other) {
  return py::array_t<double>(std::vector<py::ssize_t>(other.shape(), other.shape() + other.ndim()));
}

/// The number of rows; throws ValueError where there is none.
std::size_t rows_of(const Values& values, const char* name) {
  if (values.ndim() == 0 || values.shape(0) == 0) {
    throw std::invalid_argument(std::string(name) + " must have a row or more");
  }
  return static_cast<std::size_t>(values.shape(0));
}

Course course_of(const Values& time, const Values& source) {
  const std::size_t scans = rows_of(source, "source");
  if (time.ndim() != 1 || time.size() != source.shape(0)) {
    throw std::invalid_argument("time must have one dimension, and a value for each row of source");
  }
  return {time.data(), source.data(), scans, static_cast<std::size_t>(source.size()) / scans};
}

template <void (*Pass)(const Course&, double, double*)>
py::array_t<double> passed(const Values& time, const Values& source, double time_constant) {
  const Course course = course_of(time, source);
  py::array_t<double> response = like(source);
  Pass(course, time_constant, response.mutable_data());
  return response;
}

py::array_t<double> distance_of(const Values& force, double half_width) {
  const std::size_t scans = rows_of(force, "force");
  py::array_t<double> distance = like(force);
  play_distance(force.data(), scans, static_cast<std::size_t>(force.size()) / scans, half_width,
                distance.mutable_data());
  return distance;
}

py::array_t<double> means_of_fit(const Values& time, const Values& source, double time_constant,
                                 const Values& coefficients, double start, std::size_t first_signal,
                                 std::size_t end_of_signals, std::size_t block) {
  const Course course = course_of(time, source);
  if (source.ndim() != 2 || coefficients.ndim() != 1 || coefficients.size() != source.shape(1)) {
    throw std::invalid_argument("source must have two dimensions, and a column for each coefficient");
  }
  if (block == 0) {
    throw std::invalid_argument("block must be 1 or more");
  }
  py::array_t<double> means(
      {static_cast<py::ssize_t>(course.scans / block), static_cast<py::ssize_t>(course.columns + 2)});
  fit_columns(course, {time_constant, coefficients.data(), start, first_signal, end_of_signals}, block,
              means.mutable_data());
  return means;
}

void bind_leaky_response(py::module_& module) {
  module.def("high_pass", &passed<high_pass>, py::arg("time"), py::arg("source"), py::arg("time_constant"),
             "Return what leakage leaves of sources, from no charge at the first scan.");
  module.def("low_pass", &passed<low_pass>, py::arg("time"), py::arg("source"), py::arg("time_constant"),
             "Return first-order lags behind sources, from 0 at the first scan.");
  module.def("play_distance", &distance_of, py::arg("force"), py::arg("half_width"),
             "Return the distances of forces from their play operators, which begin at 0.");
  module.def("fit_columns", &means_of_fit, py::arg("time"), py::arg("source"), py::arg("time_constant"),
             py::arg("coefficients"), py::arg("start"), py::arg("first_signal"), py::arg("end_of_signals"),
             py::arg("block"), "Return the means of blocks of responses, derivative by the leakage rate, and decay.");
}

/// A writable view of one of the values that each taxel holds.
template <std::vector<double> ForceIntegration::State::* Member>
py::array state_of(const py::object& self) {
  auto& values = self.cast<ForceIntegration&>().state().*Member;
  return view_of(values.data(), {static_cast<py::ssize_t>(values.size())}, self);
}

template <TaxelFlags ForceIntegration::State::* Member>
py::array flags_of_state(const py::object& self) {
  return view_of(self.cast<ForceIntegration&>().state().*Member, self);
}

py::array_t<double> signal_of(ForceIntegration& integration) {
  const LeakageInverse& inverse = integration.inverse();
  py::array_t<double> signal(static_cast<py::ssize_t>(inverse.taxels()));
  for (std::size_t taxel = 0; taxel < inverse.taxels(); ++taxel) {
    signal.mutable_data()[taxel] = inverse.charge()[taxel] * inverse.newton_per_charge()[taxel];
  }
  return signal;
}

template <typename Class, typename Number, Number ForceIntegration::Block::* Member>
void bind_block(Class& bound, const char* name, const char* text) {
  bound.def_property(
      name, [](const ForceIntegration& integration) { return integration.block().*Member; },
      [](ForceIntegration& integration, Number value) { integration.block().*Member = value; }, text);
}

Taxel count_of(const ForceIntegration& integration) { return static_cast<Taxel>(integration.taxels()); }

using BoundIntegration = py::class_<ForceIntegration, std::shared_ptr<ForceIntegration>>;

void bind_integration_of_scans(BoundIntegration& bound) {
  bound
      .def(py::init([](const Values& time_constant, const Values& newton_per_charge, const Values& newton_per_kelvin,
                       double long_step, double greatest_loss, double noticeable, double fastest, double negligible,
                       std::size_t causes, double leak_per_kelvin, double leak_temperature) {
             return std::make_shared<ForceIntegration>(
                 vector_of(time_constant), vector_of(newton_per_charge), vector_of(newton_per_kelvin),
                 LeakTemperature{leak_per_kelvin, 0.0, leak_temperature},
                 IntegrationLimits{long_step, greatest_loss, noticeable, fastest, negligible}, causes);
           }),
           py::arg("time_constant"), py::arg("newton_per_charge"), py::arg("newton_per_kelvin"), py::arg("long_step"),
           py::arg("greatest_loss") = HUGE_VAL, py::arg("noticeable") = HUGE_VAL, py::arg("fastest") = 0.0,
           py::arg("negligible") = 0.0, py::arg("causes") = 1, py::arg("leak_per_kelvin") = 0.0,
           py::arg("leak_temperature") = kUnknown)
      .def(
          "start",
          [](ForceIntegration& integration, const Values& charge) {
            integration.inverse().start(values_of(charge, count_of(integration), "charge"));
          },
          py::arg("charge"), "Set the charge densities [C/m2] of a first scan, which has no predecessor.")
      .def(
          "process",
          [](ForceIntegration& integration, const Values& charge, const Temperatures& temperatures, double step) {
            return integration.process(values_of(charge, count_of(integration), "charge"), temperatures.data(),
                                       static_cast<std::size_t>(temperatures.size()), positive(step, "step"));
          },
          py::arg("charge"), py::arg("temperatures"), py::arg("step"),
          "Process a scan; return whether it has a predecessor. Without, the estimator has to start with it.")
      .def(
          "advance",
          [](ForceIntegration& integration, const Values& charge, double step) {
            return integration.advance(values_of(charge, count_of(integration), "charge"), positive(step, "step"));
          },
          py::arg("charge"), py::arg("step"),
          "Process the charge densities of a scan [C/m2]; return the deviation of what leaked in a long step [N].")
      .def("start_block", &ForceIntegration::start_block, py::arg("may_remove") = false,
           "Start a new block: clear its sums.")
      .def(
          "watch",
          [](ForceIntegration& integration, const Indices& untouched, const Values& small, double share) {
            if (small.size() != untouched.size()) {
              throw std::invalid_argument("small must have one value for each untouched taxel");
            }
            integration.watch(Taxels(untouched.data(), untouched.data() + untouched.size()), small.data(), share);
          },
          py::arg("untouched"), py::arg("small"), py::arg("share"),
          "Set the untouched taxels that show the film's temperature, their small forces [N], and the film's share.")
      .def("watch_none", &ForceIntegration::watch_none, "Watch no taxel.")
      .def("compensate_common_mode", &ForceIntegration::compensate_common_mode, py::arg("touched"),
           "Keep a uniform change out of the forces of a scan until the block ends.")
      .def("follow_untouched", &ForceIntegration::follow_untouched,
           "Subtract what the watched taxels show of the film's temperature.")
      .def(
          "remove_uniform",
          [](ForceIntegration& integration, const Tested& ignored, double noticeable, double most) {
            require_taxels(ignored, count_of(integration), "ignored");
            return integration.remove_uniform(ignored.data(), noticeable, most);
          },
          py::arg("ignored"), py::arg("noticeable"), py::arg("most"),
          "Subtract a uniform change of the other taxels; return it [N].")
      .def(
          "clip",
          [](ForceIntegration& integration, const Tested& saturated, double step) {
            require_taxels(saturated, count_of(integration), "saturated");
            integration.clip(saturated.data(), step);
          },
          py::arg("saturated"), py::arg("step"), "Note what leaked unseen of the saturated taxels in a step.");
}

void bind_integration(const py::module_& module) {
  using State = ForceIntegration::State;
  using Block = ForceIntegration::Block;
  using Bound = BoundIntegration;
  Bound bound(module, "ForceIntegration", "Forces of all taxels, and their sums over a block of scans.");
  bind_integration_of_scans(bound);
  bound.def_property_readonly("signal", &signal_of, "Charges of the last scan as forces, a new array [N].")
      .def_property_readonly("raw", &state_of<&State::raw>, "Uncorrected force of each taxel [N].")
      .def_property_readonly("change", &state_of<&State::change>, "Change of each force in the last step [N].")
      .def_property_readonly("correction", &state_of<&State::correction>, "Correction of each force [N].")
      .def_property_readonly("rate", &state_of<&State::rate>, "Rate of each correction [N/s].")
      .def_property_readonly("force", &state_of<&State::force>, "Corrected force of each taxel [N].")
      .def_property_readonly("sum", &state_of<&State::sum>, "Sum of the forces of the block's scans [N].")
      .def_property_readonly("raw_sum", &state_of<&State::raw_sum>, "Sum of the uncorrected forces [N].")
      .def_property_readonly("jumped", &state_of<&State::jumped>, "Variance of what leaked in long steps [N2].")
      .def_property_readonly("lost", &state_of<&State::lost>, "Deviation of what leaked in lost scans [N].")
      .def_property_readonly("clipped", &state_of<&State::clipped>, "Force that leaked unseen of saturated taxels [N].")
      .def_property_readonly("offset_known", &flags_of_state<&State::offset_known>, "Taxels whose offset is known.")
      .def_property_readonly("ignored", &flags_of_state<&State::ignored>, "Faulty taxels.")
      .def_property_readonly("held", &state_of<&State::held>, "Touched force at the end of the last block [N].")
      .def_property(
          "rise_deviation", [](const ForceIntegration& integration) { return integration.state().rise_deviation; },
          [](ForceIntegration& integration, double deviation) { integration.state().rise_deviation = deviation; },
          "Relative deviation of what a force has changed by since then [1].")
      .def_property_readonly(
          "correlated_error",
          [](const py::object& self) {
            auto& integration = self.cast<ForceIntegration&>();
            return view_of(integration.state().correlated_error.data(),
                           {count_of(integration), static_cast<py::ssize_t>(integration.causes())}, self);
          },
          "Factor E of the covariance E E' that the forces have in common [N]; the last cause is `lost`.")
      .def_property_readonly("thermometers", &ForceIntegration::thermometers,
                             py::return_value_policy::reference_internal, "The chip's temperature sensors.");
  bind_block<Bound, bool, &Block::started>(bound, "started", "Whether the next scan has a predecessor.");
  bind_block<Bound, bool, &Block::valid>(bound, "valid", "Whether the forces of all taxels are valid.");
  bind_block<Bound, double, &Block::scans>(bound, "scans", "Number of scans of the block.");
  bind_block<Bound, double, &Block::elapsed>(bound, "elapsed", "Their duration [s].");
  bind_block<Bound, double, &Block::square>(bound, "square", "Sum of the squares of their steps [s2].");
  bind_block<Bound, double, &Block::compensated>(bound, "compensated", "Uniform change that was removed [N].");
  bind_block<Bound, double, &Block::age>(bound, "age", "Time since the first scan [s].");
  bind_block<Bound, double, &Block::warmer>(bound, "warmer", "Temperature above that of the calibration [K].");
  bind_block<Bound, double, &Block::leak>(bound, "leak", "Rate of the leakage, relative to the calibration [1].");
  bind_block<Bound, double, &Block::reading>(bound, "reading", "New reading of the temperature sensors [K].");
  bind_block<Bound, double, &Block::sensors>(bound, "sensors", "Their last reading [K].");
  module.attr("FEWEST_FOR_UNIFORM") = kFewestForUniform;
  module.attr("LEAST_LOADED") = kLeastLoaded;
}

void bind_thermometers(const py::module_& module) {
  py::class_<Thermometers>(module, "Thermometers", "Mean change of the chip temperature since the start.")
      .def(py::init<>())
      .def_property_readonly("known", &Thermometers::known, "Whether a sensor reported in the last scan.")
      .def_property_readonly("interval", &Thermometers::interval,
                             "Interval at which new readings come [s]; NaN: unknown so far.")
      .def_property_readonly("temperature", &Thermometers::temperature,
                             "Mean of all sensors that ever reported [degC].")
      .def(
          "read",
          [](Thermometers& thermometers, const Temperatures& temperatures, double step) {
            return thermometers.read(temperatures.data(), static_cast<std::size_t>(temperatures.size()), step);
          },
          py::arg("temperatures"), py::arg("step"), "Return the mean change in a new reading [K]; NaN without one.");
  module.attr("FASTEST_WARMING") = kFastestWarming;
  module.attr("READING_NOISE") = kReadingNoise;
}

void bind_history(const py::module_& module) {
  py::class_<CountHistory, std::shared_ptr<CountHistory>>(module, "CountHistory", "Counts of the last scans.")
      .def(py::init<std::size_t, std::size_t>(), py::arg("scans"), py::arg("taxels"))
      .def_property_readonly(
          "counts",
          [](const py::object& self) {
            auto& history = self.cast<CountHistory&>();
            return view_of(history.counts().data(),
                           {static_cast<py::ssize_t>(history.capacity()), static_cast<py::ssize_t>(history.taxels())},
                           self);
          },
          "Counts of each scan, row by row.")
      .def_property_readonly(
          "close", [](const py::object& self) { return view_of(self.cast<CountHistory&>().close(), self); },
          "Whether a scan closely follows that in the row before.")
      .def_property_readonly("filled", &CountHistory::filled, "Number of scans that are kept.")
      .def(
          "add",
          [](CountHistory& history, const Counts& counts, bool close) {
            require_taxels(counts, static_cast<Taxel>(history.taxels()), "counts");
            history.add(counts.data(), close);
          },
          py::arg("counts"), py::arg("close"), "Keep the counts of a scan, unless there is no row left.")
      .def("keep", &CountHistory::keep, py::arg("rows"), "Keep the last rows only, as the first ones.");
}

}  // namespace

void bind_scan_parts(py::module_& module) {
  bind_clock(module);
  bind_crosstalk(module);
  bind_bursts(module);
  bind_thermometers(module);
  bind_integration(module);
  bind_history(module);
  bind_leaky_response(module);
}

}  // namespace posfet
