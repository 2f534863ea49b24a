// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Part of the Python module posfet_core.scan_path: what is computed at the end of every block.

#include "python_estimation.hpp"

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "../python_arrays.hpp"
#include "../python_bindings.hpp"
#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/numbers.hpp"

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
const bool* taxel_flags(const Tested& flags, const Belief& belief, const char* name) {
  require_taxels(flags, static_cast<Taxel>(belief.taxels()), name);
  return flags.data();
}

py::array_t<double> new_array(std::initializer_list<std::size_t> shape) {
  return py::array_t<double>(std::vector<py::ssize_t>(shape.begin(), shape.end()));
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
          "shared", [](const Belief& belief) { return array_of(belief.shared); },
          "Shared states, a new array, [states].")
      .def_property_readonly(
          "covariance",
          [](const Belief& belief) { return array_of(belief.covariance(), static_cast<py::ssize_t>(belief.states())); },
          "Covariance S of the shared states, a new array, [states, states].")
      .def_property_readonly("error", &view_of_taxels<&Belief::error, kOwnStates>,
                             "Errors (d, o, r, p, w) of each taxel, [taxels, own].")
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
          "cool",
          [](Belief& belief, const Values& shares) { belief.cool(shaped(shares, {belief.taxels()}, "shares")); },
          py::arg("shares"), "Let the parts of the force errors that are the taxels' own warmth vanish by shares.")
      .def(
          "forget_small_forces",
          [](Belief& belief, const Tested& where) { belief.forget_small_forces(taxel_flags(where, belief, "where")); },
          py::arg("where"), "Set the small forces r of the taxels to zero.")
      .def(
          "restart",
          [](Belief& belief, std::size_t state, double mean, double variance) {
            if (state >= belief.states()) {
              throw py::index_error("state must be a shared one");
            }
            belief.restart(state, mean, variance);
          },
          py::arg("state"), py::arg("mean"), py::arg("variance"),
          "Restart a shared state with a variance, independent of all others.")
      .def(
          "forget",
          [](Belief& belief, const Tested& where, std::size_t state) {
            const bool* chosen = taxel_flags(where, belief, "where");
            if (state >= kOwnStates) {
              throw py::index_error("state must be one of a taxel");
            }
            for (std::size_t taxel = 0; taxel < belief.taxels(); ++taxel) {
              if (chosen[taxel]) {
                belief.forget(taxel, state);
              }
            }
          },
          py::arg("where"), py::arg("state"), "Make one state of the taxels exactly known.")
      .def(
          "reset_force_error",
          [](Belief& belief, const Tested& where, const Values& shown, const Values& response, const Values& variance) {
            const bool* chosen = taxel_flags(where, belief, "where");
            const double* shows = shaped(shown, {belief.taxels()}, "shown");
            const double* responses = shaped(response, {belief.taxels(), belief.states()}, "response");
            const double* variances = shaped(variance, {belief.taxels()}, "variance");
            for (std::size_t taxel = 0; taxel < belief.taxels(); ++taxel) {
              if (chosen[taxel]) {
                belief.reset_force_error(taxel, shows[taxel], responses + taxel * belief.states(), variances[taxel]);
              }
            }
          },
          py::arg("where"), py::arg("shown"), py::arg("response"), py::arg("variance"),
          "Set the force errors of taxels to what they show [N], less what the shared states cause.");
  module.attr("OWN_STATES") = kOwnStates;
  module.attr("NEGLIGIBLE_CORRELATION") = kNegligibleCorrelation;
  module.attr("THERMAL_STATES") = py::make_tuple(kChip, kRate, kFilm, kSensor, kLag, kScale, kEarlier, kZero);
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
          "post_fit",
          [](const ForceErrorFilter& filter, const Tested& updated, const Values& measured, const Values& response,
             const Values& noise, const Values& unmodelled) {
            const Belief& belief = *filter.belief();
            const std::size_t taxels = belief.taxels();
            py::array_t<double> left = new_array({taxels});
            filter.post_fit(taxel_flags(updated, belief, "updated"), shaped(measured, {taxels}, "measured"),
                            shaped(response, {taxels, belief.states()}, "response"), shaped(noise, {taxels}, "noise"),
                            shaped(unmodelled, {taxels}, "unmodelled"), left.mutable_data());
            return left;
          },
          py::arg("updated"), py::arg("measured"), py::arg("response"), py::arg("noise"), py::arg("unmodelled"),
          "Return what is left of residuals after an update, in units of its expected deviation [1].")
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
  (filter.*Update)(taxel_flags(where, belief, "where"), shaped(residual, {taxels}, "residual"),
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
          [](const ForceErrorFilter& filter, double reading, double variance, double leaked_time) {
            const TemperatureInnovation found = filter.temperature_innovation(reading, variance, leaked_time);
            return py::make_tuple(found.innovation, array_of(found.column), found.variance);
          },
          py::arg("reading"), py::arg("variance"), py::arg("leaked_time"),
          "Return the innovation of a reading [K], its covariance with the shared states, and its variance [K2].")
      .def("measure_temperature", &ForceErrorFilter::measure_temperature, py::arg("reading"), py::arg("variance"),
           py::arg("leaked_time"), "Update by a reading of the temperature sensors.")
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
          py::arg("direction"), py::arg("variance"), "Raise the uncertainty of the shared states.")
      .def(
          "widen",
          [](ForceErrorFilter& filter, const Values& direction, double variance) {
            filter.widen(shaped(direction, {filter.belief()->states()}, "direction"), variance);
          },
          py::arg("direction"), py::arg("variance"),
          "Raise the uncertainty of the shared states, and with it that of the taxels' errors.");
  bind_measurements(bound);
  bind_updates(bound);
}

using BoundEstimator = py::class_<ForceEstimator, std::shared_ptr<ForceEstimator>>;

/// Return what an estimator finds for each taxel in an array of the caller.
template <void (ForceEstimator::*Find)(double*) const>
KeptValues find_into(const ForceEstimator& estimator, KeptValues out) {
  require_taxels(out, static_cast<Taxel>(estimator.taxels()), "out");
  (estimator.*Find)(out.mutable_data());
  return out;
}

void close_block(ForceEstimator& estimator, const Tested& touched, const py::sequence& contacts) {
  const auto taxels = static_cast<Taxel>(estimator.taxels());
  require_taxels(touched, taxels, "touched");
  const std::vector<Taxels> listed = contacts_from(contacts, taxels);
  estimator.close_block(touched.data(), pointers_to(listed));
}

void bind_estimator_methods(BoundEstimator& bound) {
  bound
      .def(
          "start",
          [](ForceEstimator& estimator, const Values& charge) {
            estimator.start(shaped(charge, {estimator.taxels()}, "charge"));
          },
          py::arg("charge"), "Start with a scan of these charge densities [C/m2], which has no predecessor.")
      .def("interrupt", &ForceEstimator::interrupt, "Record that an unknown time passes before the next scan.")
      .def("forget", &ForceEstimator::forget, "Forget all, as if the next scan were the first one.")
      .def("close_block", &close_block, py::arg("touched"), py::arg("contacts") = py::tuple(),
           "Process the block that is due: the taxels in contact at any time of it, and those of each contact.")
      .def(
          "ignore",
          [](ForceEstimator& estimator, const Tested& faulty) {
            require_taxels(faulty, static_cast<Taxel>(estimator.taxels()), "faulty");
            estimator.ignore(faulty.data());
          },
          py::arg("faulty"), "Set the faulty taxels; one that works again restarts with an unknown offset.")
      .def(
          "set_noise_variance",
          [](ForceEstimator& estimator, const Values& variance) {
            estimator.set_noise_variance(shaped(variance, {estimator.taxels()}, "variance"));
          },
          py::arg("variance"), "Set the variance of a reading of each taxel [N2].")
      .def("force_variance", &find_into<&ForceEstimator::force_variance>, py::arg("out").noconvert(),
           "Return in `out` the variance of each force that it does not share with others [N2].")
      .def("variance", &find_into<&ForceEstimator::variance>, py::arg("out").noconvert(),
           "Return in `out` the variance that each force would have without a touch [N2].")
      .def(
          "tare",
          [](ForceEstimator& estimator, bool forced) {
            py::array_t<double> change = new_array({estimator.taxels()});
            estimator.tare(forced, change.mutable_data());
            return change;
          },
          py::arg("forced") = false, "Set the forces to zero; return the correction that was added to each [N].");
}

void bind_estimator(const py::module_& module) {
  BoundEstimator bound(module, "ForceEstimator", "Force of every taxel with its covariance, block by block.");
  bound.def(py::init([](const Layout& layout, const Values& time_constant, const Values& newton_per_charge,
                        const Values& newton_per_kelvin, const Values& gain_deviation, double common_gain_deviation,
                        const Values& leak_deviation, double leak_per_kelvin, double leak_per_kelvin_deviation,
                        double leak_temperature, double noise, double threshold, double greatest_force,
                        double left_charge, double film_lag, const py::object& priors) {
              return std::make_shared<ForceEstimator>(
                  GivenArray{layout,
                             vector_of(time_constant),
                             vector_of(newton_per_charge),
                             vector_of(newton_per_kelvin),
                             vector_of(gain_deviation),
                             common_gain_deviation,
                             vector_of(leak_deviation),
                             {leak_per_kelvin, leak_per_kelvin_deviation, leak_temperature},
                             noise,
                             threshold,
                             greatest_force,
                             left_charge,
                             film_lag,
                             priors_from(priors)});
            }),
            py::kw_only(), py::arg("layout"), py::arg("time_constant"), py::arg("newton_per_charge"),
            py::arg("newton_per_kelvin"), py::arg("gain_deviation"), py::arg("common_gain_deviation"),
            py::arg("leak_deviation"), py::arg("leak_per_kelvin") = 0.0, py::arg("leak_per_kelvin_deviation") = 0.0,
            py::arg("leak_temperature") = kUnknown, py::arg("noise"), py::arg("threshold"), py::arg("greatest_force"),
            py::arg("left_charge"), py::arg("film_lag"), py::arg("priors"));
  bind_estimator_methods(bound);
  bound.def_property_readonly("integration", &ForceEstimator::integration, "What happens in every scan.")
      .def_property_readonly("belief", &ForceEstimator::belief, "Means and covariance of the force errors.")
      .def_property_readonly("block_time", &ForceEstimator::block_time, "Duration of the current block so far [s].")
      .def_property_readonly("valid", &ForceEstimator::valid, "Whether the forces of all taxels are valid.")
      .def_property_readonly("restarts", &ForceEstimator::restarts,
                             "Number of restarts of taxels whose signal was consistent with no force.")
      .def_property_readonly("processed_again", &ForceEstimator::processed_again,
                             "Number of times that the last blocks were processed again.")
      .def_property_readonly(
          "residual_charge",
          [](const ForceEstimator& estimator) {
            py::array_t<double> charge = new_array({estimator.taxels()});
            estimator.residual_charge(charge.mutable_data());
            return charge;
          },
          "Charge at each gate, as the force that would generate it [N].")
      .def_property_readonly(
          "informative",
          [](const py::object& self) { return view_of(self.cast<ForceEstimator&>().informative(), self); },
          "Faulty taxels that still show a touch; set by the caller.")
      .def_readwrite("max_relative_uncertainty", &ForceEstimator::max_relative_uncertainty,
                     "Standard deviation of the total force over that force above which forces are not valid.")
      .def_readwrite("touch_at_start", &ForceEstimator::touch_at_start,
                     "Whether forces are not valid until a release or a forced tare.");
  for (const char* name : {"force", "offset_known", "ignored", "change", "correlated_error"}) {
    bound.def_property_readonly(
        name, [name](const py::object& self) -> py::object { return self.attr("integration").attr(name); },
        "As of the integration.");
  }
  module.attr("BLOCK") = kBlock;
  module.attr("LAG") = LastBlocks::kLag;
  module.attr("RESUME_TIME") = kResumeTime;
  module.attr("MAX_RELATIVE_UNCERTAINTY") = kMaxRelativeUncertainty;
  module.attr("SHARED_STATES") = kSharedStates;
}

}  // namespace

ErrorPriors priors_from(const py::object& priors) {
  ErrorPriors found{};
  const auto read = [&priors](const char* name, auto& value) {
    value = priors.attr(name).cast<std::decay_t<decltype(value)>>();
  };
  read("film_walk", found.film_walk);
  read("rate", found.rate);
  read("rate_walk", found.rate_walk);
  read("rate_change", found.rate_change);
  read("slow_rate", found.slow_rate);
  read("touch_rate", found.touch_rate);
  read("warming_share", found.warming_share);
  read("chip_times", found.chip_times);
  read("chip_warming", found.chip_warming);
  read("fastest", found.fastest);
  read("lag", found.lag);
  read("lag_spread", found.lag_spread);
  read("dead_share", found.dead_share);
  read("scale", found.scale);
  read("reading", found.reading);
  read("bend_mean", found.bend_mean);
  read("bend", found.bend);
  read("bend_profile", found.bend_profile);
  read("leak", found.leak);
  read("tail", found.tail);
  read("tail_spread", found.tail_spread);
  read("tail_least", found.tail_least);
  read("tail_change", found.tail_change);
  read("warmth_mean", found.warmth_mean);
  read("warmth", found.warmth);
  read("warmth_least", found.warmth_least);
  read("warmth_spread", found.warmth_spread);
  read("warmth_force", found.warmth_force);
  read("warmth_steepness", found.warmth_steepness);
  read("warmth_force_spread", found.warmth_force_spread);
  read("warmth_certain", found.warmth_certain);
  read("warmth_contact", found.warmth_contact);
  read("warmth_time", found.warmth_time);
  read("creep_times", found.creep_times);
  read("creep_mean", found.creep_mean);
  read("creep", found.creep);
  read("loop_half_widths", found.loop_half_widths);
  read("loop_weights", found.loop_weights);
  read("loop_slope", found.loop_slope);
  read("pyroelectric", found.pyroelectric);
  read("earlier", found.earlier);
  read("drift", found.drift);
  read("offset_walk", found.offset_walk);
  read("motion", found.motion);
  return found;
}

std::vector<Taxels> contacts_from(const py::sequence& contacts, Taxel taxels) {
  std::vector<Taxels> found;
  for (const py::handle contact : contacts) {
    const auto indices = contact.cast<Indices>();
    found.emplace_back(indices.data(), indices.data() + indices.size());
    for (const Taxel taxel : found.back()) {
      if (taxel < 0 || taxel >= taxels) {
        throw py::index_error("contacts must have indices of taxels");
      }
    }
  }
  return found;
}

Vector<const Taxels*> pointers_to(const std::vector<Taxels>& contacts) {
  Vector<const Taxels*> pointers;
  pointers.reserve(contacts.size());
  for (const Taxels& contact : contacts) {
    pointers.push_back(&contact);
  }
  return pointers;
}

void bind_estimation(const py::module_& module) {
  bind_belief(module);
  bind_filter(module);
  bind_estimator(module);
}

}  // namespace posfet
