// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Part of the Python module posfet_core.scan_path: what is computed at the end of every block.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <stdexcept>
#include <string>

#include "../python_arrays.hpp"
#include "../python_bindings.hpp"
#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/shared_states.hpp"

namespace posfet {

namespace {

/// The values of an array of a shape; throws ValueError (std::invalid_argument) where it has another one.
const double* shaped(const Values& array, std::initializer_list<std::size_t> shape, const char* name) {
  bool fits = static_cast<std::size_t>(array.ndim()) == shape.size();
  std::string text;
  py::ssize_t axis = 0;
  for (const std::size_t size : shape) {
    fits = fits && array.shape(axis) == static_cast<py::ssize_t>(size);
    text += (axis > 0 ? ", " : "") + std::to_string(size);
    ++axis;
  }
  if (!fits) {
    throw std::invalid_argument(std::string(name) + " must have the shape [" + text + "]");
  }
  return array.data();
}

/// The flags of all taxels of a belief.
const bool* flags_of(const Tested& flags, const Belief& belief, const char* name) {
  require_taxels(flags, static_cast<Taxel>(belief.taxels()), name);
  return flags.data();
}

py::array_t<double> new_array(std::initializer_list<std::size_t> shape) {
  return py::array_t<double>(std::vector<py::ssize_t>(shape.begin(), shape.end()));
}

py::array_t<double> copy_of(const std::vector<double>& values, std::initializer_list<std::size_t> shape) {
  py::array_t<double> copy = new_array(shape);
  std::copy(values.begin(), values.end(), copy.mutable_data());
  return copy;
}

std::shared_ptr<Belief> make_belief(const Values& shared, const Values& covariance, const Values& error,
                                    const Values& slope, const Values& own) {
  const auto states = static_cast<std::size_t>(shared.size());
  const auto taxels = error.ndim() > 0 ? static_cast<std::size_t>(error.shape(0)) : 0;
  auto belief = std::make_shared<Belief>(taxels, states);
  const double* values = shaped(shared, {states}, "shared");
  belief->shared.assign(values, values + states);
  values = shaped(covariance, {states, states}, "covariance");
  belief->set_covariance(SquareMatrix(values, values + states * states));
  values = shaped(error, {taxels, kOwnStates}, "error");
  belief->error.assign(values, values + belief->error.size());
  values = shaped(slope, {taxels, kOwnStates, states}, "slope");
  belief->slope.assign(values, values + belief->slope.size());
  values = shaped(own, {taxels, kOwnStates, kOwnStates}, "own");
  belief->own.assign(values, values + belief->own.size());
  return belief;
}

/// A writable view of the values of each taxel.
template <std::vector<double> Belief::* Member, std::size_t... Shape>
py::array view_of_taxels(const py::object& self) {
  auto& belief = self.cast<Belief&>();
  std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(belief.taxels())};
  for (const std::size_t size : {Shape...}) {
    shape.push_back(static_cast<py::ssize_t>(size > 0 ? size : belief.states()));
  }
  return view_of((belief.*Member).data(), std::move(shape), self);
}

void bind_belief(const py::module_& module) {
  constexpr std::size_t kStates = 0;
  py::class_<Belief, std::shared_ptr<Belief>>(module, "Belief", "Means and covariance of the force errors.")
      .def(py::init(&make_belief), py::arg("shared"), py::arg("covariance"), py::arg("error"), py::arg("slope"),
           py::arg("own"))
      .def_property_readonly(
          "shared", [](const Belief& belief) { return copy_of(belief.shared, {belief.states()}); },
          "Shared states, a new array, [states].")
      .def_property_readonly(
          "covariance",
          [](const Belief& belief) { return copy_of(belief.covariance(), {belief.states(), belief.states()}); },
          "Covariance S of the shared states, a new array, [states, states].")
      .def_property_readonly("error", &view_of_taxels<&Belief::error, kOwnStates>,
                             "Errors (d, o, r, p) of each taxel, [taxels, own].")
      .def_property_readonly("slope", &view_of_taxels<&Belief::slope, kOwnStates, kStates>,
                             "Regression G of these errors on the shared states, [taxels, own, states].")
      .def_property_readonly("own", &view_of_taxels<&Belief::own, kOwnStates, kOwnStates>,
                             "Covariance V of these errors given the shared states, [taxels, own, own].")
      .def(
          "copy", [](const Belief& belief) { return std::make_shared<Belief>(belief); }, "Return an independent copy.")
      .def(
          "integrate",
          [](Belief& belief, const Values& leaked, const Values& driven) {
            belief.integrate(shaped(leaked, {belief.taxels()}, "leaked"),
                             shaped(driven, {belief.taxels(), belief.states()}, "driven"));
          },
          py::arg("leaked"), py::arg("driven"), "Add to the force errors what causes them within a time.")
      .def(
          "respond",
          [](Belief& belief, const Values& expected) {
            belief.respond(shaped(expected, {belief.taxels()}, "expected"));
          },
          py::arg("expected"), "Add to the force errors what the taxels' own responses make of a warmer film.")
      .def(
          "forget_small_forces",
          [](Belief& belief, const Tested& where) { belief.forget_small_forces(flags_of(where, belief, "where")); },
          py::arg("where"), "Set the small forces r of the taxels to zero.")
      .def(
          "forget",
          [](Belief& belief, const Tested& where, std::size_t state) {
            const bool* chosen = flags_of(where, belief, "where");
            if (state >= kOwnStates) {
              throw py::index_error("state must be one of a taxel");
            }
            for (std::size_t taxel = 0; taxel < belief.taxels(); ++taxel) {
              if (chosen[taxel]) {
                belief.forget(taxel, state);
              }
            }
          },
          py::arg("where"), py::arg("state"), "Make one state of the taxels exactly known.");
  module.attr("OWN_STATES") = kOwnStates;
  module.attr("NEGLIGIBLE_CORRELATION") = kNegligibleCorrelation;
  module.attr("THERMAL_STATES") = py::make_tuple(kChip, kRate, kFilm, kSensor, kLag, kScale);
}

using BoundFilter = py::class_<ForceErrorFilter>;

void bind_measurements(BoundFilter& bound) {
  bound
      .def(
          "innovation",
          [](const ForceErrorFilter& filter, const Values& measured, const Values& response, const Values& noise) {
            const std::size_t taxels = filter.belief()->taxels();
            const std::size_t states = filter.belief()->states();
            py::array_t<double> residual = new_array({taxels});
            py::array_t<double> sensitivity = new_array({taxels, states});
            py::array_t<double> deviation = new_array({taxels});
            filter.innovation(shaped(measured, {taxels}, "measured"), shaped(response, {taxels, states}, "response"),
                              shaped(noise, {taxels}, "noise"), residual.mutable_data(), sensitivity.mutable_data(),
                              deviation.mutable_data());
            return py::make_tuple(residual, sensitivity, deviation);
          },
          py::arg("measured"), py::arg("response"), py::arg("noise"),
          "Return the residuals [N], their sensitivity g to the shared states, and their expected deviation [N].")
      .def(
          "shared_variance",
          [](const ForceErrorFilter& filter, const Values& sensitivity) {
            const Belief& belief = *filter.belief();
            py::array_t<double> variance = new_array({belief.taxels()});
            filter.shared_variance(shaped(sensitivity, {belief.taxels(), belief.states()}, "sensitivity"),
                                   variance.mutable_data());
            return variance;
          },
          py::arg("sensitivity"), "Return the variance that the shared states give to residuals [N2].")
      .def(
          "own_deviation",
          [](const ForceErrorFilter& filter, const Values& deviation, const Values& sensitivity, const Values& noise) {
            const Belief& belief = *filter.belief();
            const std::size_t taxels = belief.taxels();
            py::array_t<double> own = new_array({taxels});
            filter.own_deviation(shaped(deviation, {taxels}, "deviation"),
                                 shaped(sensitivity, {taxels, belief.states()}, "sensitivity"),
                                 shaped(noise, {taxels}, "noise"), own.mutable_data());
            return own;
          },
          py::arg("deviation"), py::arg("sensitivity"), py::arg("noise"),
          "Return the deviation of residuals without what the shared states contribute [N].")
      .def(
          "predicted",
          [](const ForceErrorFilter& filter, const Values& response) {
            const Belief& belief = *filter.belief();
            py::array_t<double> errors = new_array({belief.taxels()});
            filter.predicted(shaped(response, {belief.taxels(), belief.states()}, "response"), errors.mutable_data());
            return errors;
          },
          py::arg("response"), "Return the errors of the forces for given responses to the shared states [N].")
      .def(
          "covariance_root",
          [](const ForceErrorFilter& filter, const Values& response) {
            const Belief& belief = *filter.belief();
            py::array_t<double> own = new_array({belief.taxels()});
            py::array_t<double> factor = new_array({belief.taxels(), belief.states()});
            filter.covariance_root(shaped(response, {belief.taxels(), belief.states()}, "response"), own.mutable_data(),
                                   factor.mutable_data());
            return py::make_tuple(own, factor);
          },
          py::arg("response"), "Return the own variance of each force error [N2] and a factor of what they share [N].");
}

/// `update` and `update_alone` as methods.
template <void (ForceErrorFilter::*Update)(const bool*, const double*, const double*, const double*)>
void update(ForceErrorFilter& filter, const Tested& where, const Values& residual, const Values& sensitivity,
            const Values& noise) {
  const Belief& belief = *filter.belief();
  const std::size_t taxels = belief.taxels();
  (filter.*Update)(flags_of(where, belief, "where"), shaped(residual, {taxels}, "residual"),
                   shaped(sensitivity, {taxels, belief.states()}, "sensitivity"), shaped(noise, {taxels}, "noise"));
}

void bind_updates(BoundFilter& bound) {
  bound
      .def("update", &update<&ForceErrorFilter::update>, py::arg("where"), py::arg("residual"), py::arg("sensitivity"),
           py::arg("noise"), "Update by the residuals of the masked taxels.")
      .def("update_alone", &update<&ForceErrorFilter::update_alone>, py::arg("where"), py::arg("residual"),
           py::arg("sensitivity"), py::arg("noise"),
           "Update the masked taxels by residuals that say nothing about the shared states.")
      .def(
          "temperature_innovation",
          [](const ForceErrorFilter& filter, double reading, double variance) {
            const TemperatureInnovation found = filter.temperature_innovation(reading, variance);
            return py::make_tuple(found.innovation, copy_of(found.column, {found.column.size()}), found.variance);
          },
          py::arg("reading"), py::arg("variance"),
          "Return the innovation of a reading [K], its covariance with the shared states, and its variance [K2].")
      .def("measure_temperature", &ForceErrorFilter::measure_temperature, py::arg("reading"), py::arg("variance"),
           "Update by a reading of the temperature sensors.")
      .def(
          "measure_shared",
          [](ForceErrorFilter& filter, double innovation, const Values& sensitivity, double variance) {
            filter.measure_shared(innovation, shaped(sensitivity, {filter.belief()->states()}, "sensitivity"),
                                  variance);
          },
          py::arg("innovation"), py::arg("sensitivity"), py::arg("variance"),
          "Update by a measurement of the shared states alone.")
      .def(
          "restart_temperature",
          [](ForceErrorFilter& filter, double reading, const Values& shared, const Values& covariance) {
            const std::size_t states = filter.belief()->states();
            filter.restart_temperature(reading, shaped(shared, {states}, "shared"),
                                       shaped(covariance, {states, states}, "covariance"));
          },
          py::arg("reading"), py::arg("shared"), py::arg("covariance"),
          "Forget the temperatures, but for a reading of the sensors, after a time that is unknown.");
}

void bind_filter(const py::module_& module) {
  BoundFilter bound(module, "ForceErrorFilter", "Predicts and updates a belief.");
  bound.def(py::init<std::shared_ptr<Belief>>(), py::arg("belief"))
      .def_property("belief", &ForceErrorFilter::belief, &ForceErrorFilter::set_belief, "The belief.")
      .def(
          "predict",
          [](ForceErrorFilter& filter, const Values& after, const Values& matrix, const Values& noise,
             const Values& leaked, const Values& driven, const Values& own_noise) {
            const std::size_t taxels = filter.belief()->taxels();
            const std::size_t states = filter.belief()->states();
            filter.predict({shaped(after, {states}, "after"), shaped(matrix, {states, states}, "matrix"),
                            shaped(noise, {states, states}, "noise"), shaped(leaked, {taxels}, "leaked"),
                            shaped(driven, {taxels, states}, "driven"),
                            shaped(own_noise, {taxels, kOwnStates, kOwnStates}, "own_noise")});
          },
          py::arg("after"), py::arg("matrix"), py::arg("noise"), py::arg("leaked"), py::arg("driven"),
          py::arg("own_noise"), "Propagate over a block.")
      .def(
          "admit",
          [](ForceErrorFilter& filter, const Values& direction, double variance) {
            filter.admit(shaped(direction, {filter.belief()->states()}, "direction"), variance);
          },
          py::arg("direction"), py::arg("variance"), "Raise the uncertainty of the shared states.");
  bind_measurements(bound);
  bind_updates(bound);
}

}  // namespace

void bind_estimation(const py::module_& module) {
  bind_belief(module);
  bind_filter(module);
}

}  // namespace posfet
