// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Part of the Python module posfet_core.scan_path: what the estimator of static force is made of, one by one.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "../python_arrays.hpp"
#include "../python_bindings.hpp"
#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/error_states.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/held_forces.hpp"
#include "posfet_core/estimation/jump_noise.hpp"
#include "posfet_core/estimation/lone_drift.hpp"
#include "posfet_core/estimation/lower_bound_monitor.hpp"
#include "posfet_core/estimation/object_heating.hpp"
#include "posfet_core/estimation/release_detector.hpp"
#include "posfet_core/estimation/rest_detector.hpp"
#include "posfet_core/estimation/signal_steps.hpp"
#include "posfet_core/estimation/steady_force.hpp"
#include "posfet_core/estimation/temperature_walk.hpp"
#include "posfet_core/estimation/thermal_contact.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/estimation/unexplained_residuals.hpp"
#include "posfet_core/estimation/uniform_change.hpp"
#include "posfet_core/estimation/zero_refutation.hpp"
#include "python_estimation.hpp"

namespace posfet {

namespace {

TaxelFlags copy_of(const Tested& flags) {
  TaxelFlags copy(static_cast<std::size_t>(flags.size()));
  copy.set(flags.data());
  return copy;
}

/// A part with the constants of its own that it refers to.
template <typename Part, typename Constants, typename... Others>
std::shared_ptr<Part> part_of(Constants constants, Others... others) {
  struct Whole {
    explicit Whole(Constants given, Others... rest) : constants(std::move(given)), part(constants, rest...) {}
    const Constants constants;
    Part part;
  };
  const auto whole = std::make_shared<Whole>(std::move(constants), others...);
  return std::shared_ptr<Part>(whole, &whole->part);
}

/// Throws ValueError where the arrays have not one value for each taxel.
void require_all(std::size_t taxels, std::initializer_list<py::array> arrays) {
  for (const py::array& array : arrays) {
    require_taxels(array, static_cast<Taxel>(taxels), "each array");
  }
}

/// What a part knows of each taxel, as a new array.
template <typename Part, typename Value>
auto of_each_taxel(Value (Part::*find)(std::size_t) const) {
  return [find](const Part& part) {
    py::array_t<Value> values(static_cast<py::ssize_t>(part.taxels()));
    for (std::size_t taxel = 0; taxel < part.taxels(); ++taxel) {
      values.mutable_data()[taxel] = (part.*find)(taxel);
    }
    return values;
  };
}

void bind_surroundings(const py::module_& module) {
  py::class_<ContactSurroundings>(module, "ContactSurroundings", "Neighbours of the taxels of an array.")
      .def(py::init([](const Layout& layout) { return ContactSurroundings(Grid(layout)); }), py::arg("layout"))
      .def(
          "dilated",
          [](const ContactSurroundings& surroundings, const Tested& mask) {
            require_all(surroundings.taxels(), {mask});
            TaxelFlags dilated(surroundings.taxels());
            surroundings.dilate(copy_of(mask), dilated);
            return array_of(dilated);
          },
          py::arg("mask"), "Return a mask of taxels with their neighbours.")
      .def(
          "completed",
          [](const ContactSurroundings& surroundings, const Values& force, double least) {
            require_all(surroundings.taxels(), {force});
            std::vector<double> completed = vector_of(force);
            surroundings.complete(completed, least);
            return array_of(completed);
          },
          py::arg("force"), py::arg("least"), "Return the forces with the greatest that each unknown one can be [N].")
      .def(
          "greatest_neighbour",
          [](const ContactSurroundings& surroundings, const Values& force) {
            require_all(surroundings.taxels(), {force});
            std::vector<double> greatest(surroundings.taxels());
            surroundings.greatest_neighbour(vector_of(force), greatest);
            return array_of(greatest);
          },
          py::arg("force"), "Return the greatest force of each taxel's neighbours [N].")
      .def(
          "geometric_decline",
          [](const ContactSurroundings& surroundings, const Values& force, double least) {
            require_all(surroundings.taxels(), {force});
            std::vector<double> decline(surroundings.taxels());
            surroundings.geometric_decline(vector_of(force), least, decline);
            return array_of(decline);
          },
          py::arg("force"), py::arg("least"), "Return the force of each taxel if forces declined geometrically [N].");
  module.attr("DIAGONAL") = kDiagonal;
}

void bind_dynamics(const py::module_& module) {
  constexpr auto kStates = static_cast<py::ssize_t>(kSharedStates);
  py::class_<SharedDynamics, std::shared_ptr<SharedDynamics>> bound(module, "SharedDynamics",
                                                                    "Transition of the shared states over a block.");
  bound.attr("FORGET") = SharedDynamics::kForget;
  bound
      .def(py::init([](const py::object& priors, double film_lag) {
             return part_of<SharedDynamics>(priors_from(priors), film_lag);
           }),
           py::arg("priors"), py::arg("film_lag"))
      .def(
          "transition",
          [](SharedDynamics& dynamics, const Values& state, double duration, double warming) {
            require_all(kSharedStates, {state});
            const SharedTransition& found = dynamics.transition(vector_of(state), duration, warming);
            return py::make_tuple(array_of(found.after), array_of(found.matrix, kStates),
                                  array_of(found.noise, kStates));
          },
          py::arg("state"), py::arg("duration"), py::arg("warming") = 0.0,
          "Return next state, transition matrix and covariance of the noise.");
}

void bind_touch_response(const py::module_& module) {
  py::class_<TouchResponse, std::shared_ptr<TouchResponse>>(module, "TouchResponse",
                                                            "Responses of the force errors to the shared states.")
      .def(py::init([](const Layout& layout, const Values& time_constant, const Values& newton_per_kelvin,
                       const py::object& priors) {
             require_all(static_cast<std::size_t>(Grid(layout).taxels()), {time_constant, newton_per_kelvin});
             GivenArray array{};
             array.layout = layout;
             array.time_constant = vector_of(time_constant);
             array.newton_per_kelvin = vector_of(newton_per_kelvin);
             array.newton_per_charge = array.gain_deviation = array.leak_deviation = array.time_constant;  // not used
             array.priors = priors_from(priors);
             return part_of<TouchResponse>(EstimatedArray(std::move(array)));
           }),
           py::arg("layout"), py::arg("time_constant"), py::arg("newton_per_kelvin"), py::arg("priors"))
      .def("reset", &TouchResponse::reset, "Forget all touches.")
      .def_property_readonly(
          "warm", [](const TouchResponse& response) { return array_of(response.warm()); },
          "Warmth of each taxel relative to the steady one [1], a new array.")
      .def_property_readonly(
          "loops", [](const TouchResponse& response) { return array_of(response.loops()); },
          "Charge by which the film's hysteresis differs from that of the force, as a force [N].")
      .def_property_readonly(
          "range", [](const TouchResponse& response) { return array_of(response.range()); },
          "By how much more it may be with the greatest thermal contact that there may be [1], a new array.")
      .def_property_readonly("leaked", of_each_taxel(&TouchResponse::leaked),
                             "Leaked charge of the touched force of each taxel, as a force [N].")
      .def(
          "advance",
          [](TouchResponse& response, const Values& force, const Values& least, const Values& most, double duration,
             double leak, double warmth) {
            require_all(response.taxels(), {force, least, most});
            response.advance(vector_of(force), vector_of(least), vector_of(most), duration, {leak, warmth});
          },
          py::arg("force"), py::arg("least"), py::arg("most"), py::arg("duration"), py::arg("leak") = 0.0,
          py::arg("warmth") = 0.0, "Advance by a block.")
      .def(
          "reduce_warmth",
          [](TouchResponse& response, std::size_t taxel, double left, double warmth) {
            if (taxel >= response.taxels()) {
              throw py::index_error("no such taxel");
            }
            response.reduce_warmth(taxel, left, warmth);
          },
          py::arg("taxel"), py::arg("left"), py::arg("warmth"),
          "Take what is left of the force of a taxel that was released for the warmth of that force.")
      .def(
          "matrix",
          [](const TouchResponse& response) {
            std::vector<double> matrix(response.taxels() * kSharedStates);
            response.matrix(matrix.data());
            return array_of(matrix, static_cast<py::ssize_t>(kSharedStates));
          },
          "Return the responses of the force errors to the shared states, [taxels, states].");
}

void bind_held_forces(const py::module_& module) {
  py::class_<HeldForces, std::shared_ptr<HeldForces>>(
      module, "HeldForces", "Forces of weakly touched taxels beside what certainly presses, and rests.")
      .def(py::init([](const Layout& layout) { return part_of<HeldForces>(Grid(layout)); }), py::arg("layout"))
      .def(
          "update",
          [](HeldForces& forces, const Values& force, const Tested& certain, double duration) {
            require_all(forces.taxels(), {force, certain});
            forces.update(vector_of(force), copy_of(certain), duration);
          },
          py::arg("force"), py::arg("certain"), py::arg("duration"), "Process a block.")
      .def_property_readonly("held", of_each_taxel(&HeldForces::held),
                             "Forces when those beside them came to rest [N]; 0: unknown, or they do not rest.");
  module.attr("HELD_PLAY") = kHeldPlay;
  module.attr("HELD_TIME") = kHeldTime;
}

void bind_thermal_contact(const py::module_& module) {
  py::class_<ThermalContact> contact(module, "ThermalContact",
                                     "What the readings of taxels show of the thermal contact, where warmth hides "
                                     "forces.");
  contact.def(py::init<std::size_t, double, double>(), py::arg("taxels"), py::arg("warmth_time"), py::arg("threshold"))
      .def("reset", &ThermalContact::reset, "Forget all readings.")
      .def(
          "update",
          [](ThermalContact& self, const Values& reading, double duration) {
            require_all(self.taxels(), {reading});
            self.update(vector_of(reading), duration);
          },
          py::arg("reading"), py::arg("duration"), "Process a block: what taxels read but for their warmth [N].")
      .def_property_readonly("warmed", of_each_taxel(&ThermalContact::warmed),
                             "Whether something warms each taxel, [taxels].")
      .def(
          "find_left",
          [](ThermalContact& self, const py::sequence& contacts) {
            const std::vector<Taxels> taxels = contacts_from(contacts, static_cast<Taxel>(self.taxels()));
            TaxelFlags left(self.taxels());
            self.find_left(pointers_to(taxels), left);
            return array_of(left);
          },
          py::arg("contacts"), "Return the taxels of contacts that were left, [taxels]; once per block.");
  contact.attr("BLOCKS") = ThermalContact::kBlocks;
}

void bind_noise(const py::module_& module) {
  py::class_<JumpNoise, std::shared_ptr<JumpNoise>>(module, "JumpNoise",
                                                    "Random walk of each force error due to steps of its signal.")
      .def(py::init([](const Values& time_constant) { return part_of<JumpNoise>(vector_of(time_constant)); }),
           py::arg("time_constant"))
      .def(
          "observe",
          [](JumpNoise& jumps, const Tested& where, const Values& step, const Values& change, const Values& noise,
             double duration) {
            require_all(jumps.taxels(), {where, step, change, noise});
            jumps.observe(where.data(), step.data(), change.data(), noise.data(), duration);
          },
          py::arg("where"), py::arg("step"), py::arg("change"), py::arg("noise"), py::arg("duration"),
          "Process the steps of the signals, and the changes of the mean forces while nothing touches.")
      .def(
          "variance",
          [](const JumpNoise& jumps, double duration) {
            std::vector<double> variance(jumps.taxels());
            for (std::size_t taxel = 0; taxel < variance.size(); ++taxel) {
              variance[taxel] = jumps.variance(taxel, duration);
            }
            return array_of(variance);
          },
          py::arg("duration"), "Return the variance by which each force error grows in a time [N2].")
      .def("least_offset_variance", of_each_taxel(&JumpNoise::least_offset_variance),
           "Return the least variance of each offset [N2].");
  py::class_<LoneDrift> drift(module, "LoneDrift", "Finds drifts of single taxels in windows of blocks.");
  py::class_<LoneDrift::Drift>(drift, "Drift", "A drift of one taxel.")
      .def_readonly("taxel", &LoneDrift::Drift::taxel, "Index of the taxel.")
      .def_readonly("rate", &LoneDrift::Drift::rate, "Of its force [N/s].")
      .def_readonly("earliest", &LoneDrift::Drift::earliest, "Time for which it may have been there [s].")
      .def_readonly("latest", &LoneDrift::Drift::latest, "Time for which it has been there [s].");
  drift.def(py::init<std::size_t>(), py::arg("taxels"))
      .def("restart", &LoneDrift::restart, "Forget the last blocks: a correction since then is no drift.")
      .def(
          "observe",
          [](LoneDrift& self, const Values& mean, const Tested& counts, const Tested& listed, const Tested& touched,
             double variance, double duration) {
            require_all(self.taxels(), {mean, counts, listed, touched});
            return self.observe(mean.data(), counts.data(), listed.data(), touched.data(), variance, duration);
          },
          py::arg("mean"), py::arg("counts"), py::arg("listed"), py::arg("touched"), py::arg("variance"),
          py::arg("duration"), "Process a block; return a drift once it is known.");
  drift.attr("BLOCKS") = LoneDrift::kBlocks;
  drift.attr("WINDOWS") = LoneDrift::kWindows;

  module.attr("DWELL") = kDwell;
  module.attr("JUMP_MEMORY") = kJumpMemory;

  py::class_<TemperatureWalk>(module, "TemperatureWalk", "Random walk of the chip temperature.")
      .def(py::init<double, double>(), py::arg("least"), py::arg("film_lag"))
      .def("pause", &TemperatureWalk::pause, "Forget the temperatures.")
      .def("observe", &TemperatureWalk::observe, py::arg("rise"), py::arg("variance"), py::arg("duration"),
           "Process the rise of the film's temperature from one block to the next.")
      .def_property_readonly("intensity", &TemperatureWalk::intensity,
                             "Variance by which the temperature grows in each second [K2/s].");

  py::class_<RestDetector> rest(module, "RestDetector", "Detects rest block by block.");
  rest.def(py::init<std::size_t, double, double, double>(), py::arg("taxels"), py::arg("noise"),
           py::arg("offset_spread"), py::arg("time_constant"))
      .def(
          "start",
          [](RestDetector& detector, const Values& signal) {
            require_all(detector.taxels(), {signal});
            detector.start(signal.data());
          },
          py::arg("signal"), "Set the reference signals [N] from the first scan.")
      .def(
          "update",
          [](RestDetector& detector, const Values& signal, const Tested& ignored, double duration, bool warming) {
            require_all(detector.taxels(), {signal, ignored});
            return detector.update(signal.data(), ignored.data(), duration, warming);
          },
          py::arg("signal"), py::arg("ignored"), py::arg("duration"), py::arg("warming") = false,
          "Process the signals at the end of a block; return whether the array is at rest.")
      .def_property_readonly("moved", &RestDetector::moved, "Whether a signal moved in the last block.");
  rest.attr("STILL") = RestDetector::kStill;
  rest.attr("SINGLE_TAXEL_FACTOR") = RestDetector::kSingleTaxelFactor;
  rest.attr("LEAKED") = RestDetector::kLeaked;
}

void bind_validity(const py::module_& module) {
  py::class_<LowerBoundMonitor>(module, "LowerBoundMonitor", "Marks the taxels whose force is a lower bound.")
      .def(py::init<std::size_t, double, double, double>(), py::arg("taxels"), py::arg("threshold"),
           py::arg("negative_time"), py::arg("release_time"))
      .def_property_readonly(
          "mask", [](const LowerBoundMonitor& monitor) { return array_of(monitor.mask()); },
          "Taxels whose force is a lower bound, a new array.")
      .def(
          "start",
          [](LowerBoundMonitor& monitor, const Values& before, const Values& remaining) {
            require_all(monitor.mask().size(), {before, remaining});
            monitor.start(before.data(), remaining.data());
          },
          py::arg("before"), py::arg("remaining"), "Mark taxels after an interruption.")
      .def(
          "update",
          [](LowerBoundMonitor& monitor, const Values& mean, const Tested& still, double elapsed) {
            require_all(monitor.mask().size(), {mean, still});
            TaxelFlags ended(monitor.mask().size());
            monitor.update(mean.data(), still.data(), elapsed, ended.data());
            return array_of(ended);
          },
          py::arg("mean"), py::arg("still"), py::arg("elapsed"),
          "Process the mean forces of a block; return the mask of those that were released.");
}

void bind_residuals(const py::module_& module) {
  using Residuals = UnexplainedResiduals;
  py::class_<Residuals> bound(module, "UnexplainedResiduals", "Taxels whose residual no state explains.");
  bound.def(py::init<std::size_t, double>(), py::arg("taxels"), py::arg("threshold"))
      .def_property_readonly(
          "rising", [](const Residuals& residuals) { return array_of(residuals.rising()); },
          "Taxels with a positive residual, a new array.")
      .def_property_readonly(
          "below", [](const Residuals& residuals) { return array_of(residuals.below()); },
          "Time for which each taxel has been below zero [s], a new array.")
      .def(
          "persistent",
          [](Residuals& residuals, const Tested& where, const Values& residual) {
            require_all(residuals.below().size(), {where, residual});
            TaxelFlags odd(residuals.below().size());
            residuals.add_persistent(where.data(), residual.data(), odd.data());
            return array_of(odd);
          },
          py::arg("where"), py::arg("residual"),
          "Process a block; return the taxels whose residuals have been positive in too many blocks.")
      .def(
          "update",
          [](Residuals& residuals, const Tested& odd, const Values& residual, const Values& mean, const Values& noise,
             double duration) {
            require_all(residuals.below().size(), {odd, residual, mean, noise});
            TaxelFlags errors(residuals.below().size());
            residuals.update(odd.data(), residual.data(), mean.data(), noise.data(), duration, errors.data());
            return array_of(errors);
          },
          py::arg("odd"), py::arg("residual"), py::arg("mean"), py::arg("noise"), py::arg("duration"),
          "Process a block; return the taxels whose residual is an error of the baseline.")
      .def("reset", &Residuals::reset, "Forget everything but the averages.");
  bound.attr("NEGATIVE_TIME") = Residuals::kNegativeTime;
  bound.attr("UNEXPLAINED_TIME") = Residuals::kUnexplainedTime;
  bound.attr("SMALL") = Residuals::kSmall;
  bound.attr("PERSISTENT_BLOCKS") = Residuals::kPersistentBlocks;
  module.attr("GATE") = kGate;
}

void bind_release(const py::module_& module) {
  py::class_<ReleaseDetector> bound(module, "ReleaseDetector", "Finds contacts that are listed, but were released.");
  bound.def(py::init<std::size_t>(), py::arg("taxels"))
      .def(
          "update",
          [](ReleaseDetector& detector, const py::sequence& contacts, const Values& mean, const Values& course,
             const Values& rise, const Tested& touched, const Values& variance, const Values& noise, double duration) {
            require_all(detector.taxels(), {mean, course, rise, touched, variance, noise});
            const std::vector<Taxels> taxels = contacts_from(contacts, static_cast<Taxel>(detector.taxels()));
            TaxelFlags released(detector.taxels());
            detector.update(pointers_to(taxels), mean.data(), course.data(), rise.data(), touched.data(),
                            variance.data(), noise.data(), duration, released.data());
            return array_of(released);
          },
          py::arg("contacts"), py::arg("mean"), py::arg("course"), py::arg("rise"), py::arg("touched"),
          py::arg("variance"), py::arg("noise"), py::arg("duration"),
          "Process a block; return the taxels of released contacts.")
      .def(
          "has_left",
          [](const ReleaseDetector& detector, std::size_t taxel, double mean, double noise) {
            if (taxel >= detector.taxels()) {
              throw std::invalid_argument("taxel must be one of the array");
            }
            return detector.has_left(taxel, mean, noise);
          },
          py::arg("taxel"), py::arg("mean"), py::arg("noise"), "Return whether nothing touches a taxel any more.");
  bound.attr("STILL_BLOCKS") = kStillBlocks;
  bound.attr("RELEASED_BLOCKS") = ReleaseDetector::kReleasedBlocks;
  bound.attr("RELEASED_SHARE") = ReleaseDetector::kReleasedShare;
}

void bind_object_heating(const py::module_& module) {
  py::class_<ObjectHeating>(module, "ObjectHeating", "Follows how an object has changed the rate of the temperature.")
      .def(py::init())
      .def("update", &ObjectHeating::update, py::arg("before"), py::arg("force"), py::arg("rate"), py::arg("deviation"),
           py::arg("earlier"), "Process a block; return by how much the rate may change as the force falls [K/s/N].");
}

void bind_zero_refutation(const py::module_& module) {
  py::class_<ZeroRefutation>(module, "ZeroRefutation", "Decides whether something wide presses that zeros have hidden.")
      .def(py::init())
      .def_property_readonly("wide", &ZeroRefutation::wide, "Whether zeros have been refuted, and it has not left.")
      .def_property_readonly("significant", &ZeroRefutation::significant, "Whether the total force is significant.")
      .def("refute", &ZeroRefutation::refute, "Record that zeros have been refuted.")
      .def("end_block", &ZeroRefutation::end_block, py::arg("duration"), py::arg("total"), py::arg("deviation"),
           "Process the end of a block.")
      .def("clear", &ZeroRefutation::clear, "Forget what presses.");
}

void bind_uniform(const py::module_& module) {
  py::class_<UniformChange, std::shared_ptr<UniformChange>> bound(module, "UniformChange",
                                                                  "Hypothesis that all taxels changed with the film.");
  bound
      .def(py::init([](const Values& newton_per_kelvin, double spread) {
             return part_of<UniformChange>(vector_of(newton_per_kelvin), spread);
           }),
           py::arg("newton_per_kelvin"), py::arg("spread"))
      .def_property_readonly("observable", &UniformChange::observable, "Whether the pattern is informative.")
      .def_property_readonly("open", &UniformChange::open, "Whether the hypothesis is open for a rise of the forces.")
      .def(
          "temperature",
          [](UniformChange& uniform, const Values& residual, const Tested& where, const Values& deviation,
             const Values& own, double duration, bool noticed) {
            require_all(uniform.taxels(), {residual, where, deviation, own});
            return uniform.temperature(residual.data(), where.data(), deviation.data(), own.data(), duration, noticed);
          },
          py::arg("residual"), py::arg("where"), py::arg("deviation"), py::arg("own"), py::arg("duration"),
          py::arg("noticed") = false, "Return the temperature change that explains the residuals [K]; 0: none.")
      .def("begin", &UniformChange::begin, "Open the hypothesis.")
      .def(
          "is_refused",
          [](UniformChange& uniform, const Tested& odd, const Tested& where, double claimed, double shown,
             double deviation, double negligible, double wait, double duration) {
            require_all(uniform.taxels(), {odd, where});
            std::size_t both = 0;
            std::size_t judged = 0;
            for (std::size_t taxel = 0; taxel < uniform.taxels(); ++taxel) {
              both += odd.data()[taxel] && where.data()[taxel] ? 1 : 0;
              judged += where.data()[taxel] ? 1 : 0;
            }
            return uniform.is_refused(both, judged, {claimed, shown, deviation, negligible, wait}, duration);
          },
          py::arg("odd"), py::arg("where"), py::arg("claimed"), py::arg("shown"), py::arg("deviation"),
          py::arg("negligible"), py::arg("wait"), py::arg("duration"),
          "Process a block; return whether the open hypothesis is wrong.")
      .def("refuse", &UniformChange::refuse, "Close the hypothesis as wrong.")
      .def("close", &UniformChange::close, "Close the hypothesis, wrong or not.");
  bound.attr("MISFITS") = UniformChange::kMisfits;
  bound.attr("CONFIRMED") = UniformChange::kConfirmed;
  bound.attr("DISTINCT") = UniformChange::kDistinct;
  bound.attr("PAUSE") = UniformChange::kPause;
}

/// Columns of a matrix.
Vector<Vector<double>> columns_of(const Values& matrix) {
  Vector<Vector<double>> columns(static_cast<std::size_t>(matrix.shape(1)));
  for (py::ssize_t row = 0; row < matrix.shape(0); ++row) {
    for (py::ssize_t column = 0; column < matrix.shape(1); ++column) {
      columns[static_cast<std::size_t>(column)].push_back(*matrix.data(row, column));
    }
  }
  return columns;
}

void bind_steady_force(const py::module_& module) {
  py::class_<SharedMeasurement>(module, "SharedMeasurement", "A measurement of the shared states.")
      .def_readonly("innovation", &SharedMeasurement::innovation, "Measured less expected value.")
      .def_property_readonly(
          "sensitivity", [](const SharedMeasurement& measured) { return array_of(measured.sensitivity); },
          "Sensitivity to the shared states, [states].")
      .def_readonly("variance", &SharedMeasurement::variance, "Variance of the noise.");
  py::class_<SteadyForce>(module, "SteadyForce", "Finds what forces that are held tell, and how steady they have been.")
      .def(py::init<>())
      .def(
          "observe",
          [](SteadyForce& self, const Values& time, const Values& force, const Values& charge, const Values& response,
             double warmed, double noise) {
            const py::ssize_t blocks = time.size();
            for (const Values& values : {force, charge, response}) {
              if (values.ndim() != 2 || values.shape(0) != blocks || blocks < 4) {
                throw std::invalid_argument("force, charge and response must have a row for each block, at least four");
              }
            }
            if (charge.shape(1) != force.shape(1)) {
              throw std::invalid_argument("force and charge must be of the same taxels");
            }
            const auto taxels = static_cast<std::size_t>(force.shape(1));
            SteadyWindow window({time.data(), time.data() + blocks}, taxels);
            for (py::ssize_t block = 0; block < blocks; ++block) {
              for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
                const auto column = static_cast<py::ssize_t>(taxel);
                window.add(static_cast<std::size_t>(block), taxel, *force.data(block, column),
                           *charge.data(block, column));
              }
            }
            window.response = columns_of(response);
            return self.observe(window, warmed, noise);
          },
          py::arg("time"), py::arg("force"), py::arg("charge"), py::arg("response"), py::arg("warmed"),
          py::arg("noise"),
          "Return what the touched taxels together tell of the shared states in a window of blocks; None: nothing.");
  module.attr("HOP") = kHop;
  module.attr("STEADINESS") = kSteadiness;
}

void bind_signal_steps(py::module_& module) {
  module.def(
      "signal_steps",
      [](const Values& time, const Values& force, const Values& noise, const Values& time_constant) {
        const py::ssize_t taxels = time_constant.size();
        const auto blocks = static_cast<py::ssize_t>(kStepWindow);
        if (time.size() != blocks || force.ndim() != 2 || force.shape(0) != blocks || force.shape(1) != taxels) {
          throw std::invalid_argument("time and force must have a row for each block of the window");
        }
        require_all(static_cast<std::size_t>(taxels), {noise});
        StepWindow window{{time.data(), time.data() + time.size()}, {}, noise.data(), nullptr};
        for (py::ssize_t block = 0; block < blocks; ++block) {
          window.force.push_back(force.data(block, 0));
        }
        const TaxelFlags all(static_cast<std::size_t>(taxels), true);
        window.where = all.data();
        std::vector<double> step(static_cast<std::size_t>(taxels));
        find_signal_steps(window, vector_of(time_constant), step.data());
        return array_of(step);
      },
      py::arg("time"), py::arg("force"), py::arg("noise"), py::arg("time_constant"),
      "Return the steps of single signals in the middle of a window [N]; 0: none.");
  module.attr("STEP_HALF") = kStepHalf;
}

}  // namespace

void bind_estimation_parts(py::module_& module) {
  bind_surroundings(module);
  bind_dynamics(module);
  bind_touch_response(module);
  bind_held_forces(module);
  bind_thermal_contact(module);
  bind_noise(module);
  bind_validity(module);
  bind_residuals(module);
  bind_release(module);
  bind_object_heating(module);
  bind_zero_refutation(module);
  bind_uniform(module);
  bind_steady_force(module);
  bind_signal_steps(module);
}

}  // namespace posfet
