// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// When the temperature sensors say that zeros are wrong.
#pragma once

namespace posfet {

/// Finds that something presses on all taxels, too slowly to be noticed, from readings of the temperature sensors.
///
/// Zeros of the taxels that it presses make a temperature of the film of its force, which the sensors do not show. A
/// press is nothing but a reading that contradicts zeros in its direction after the rate of that temperature has turned
/// there: in one reading where the rate has changed by more than its dynamics let expect, or in several in turn where
/// the lag of the sensors is calibrated, which would explain them otherwise.
class ZeroRefutation {
public:
  /// Deviations by which a reading must contradict zeros that have changed the rate beyond its dynamics [1].
  static constexpr double kContradicted = 2.0;

  /// Number of unexpected readings in turn that contradict them without such a change [1].
  static constexpr int kInTurn = 2;

  /// Time over which the rate at rest is averaged, and in which a press is forgotten that no contact shows [s],
  /// assumed.
  static constexpr double kMemory = 10.0;

  /// Mean signal of a change of the film's temperature [N/K], and whether the lag of the sensors is calibrated.
  ZeroRefutation(double newton_per_kelvin, bool lag_known) : per_kelvin_(newton_per_kelvin), lag_known_(lag_known) {}

  /// What zeros may have hidden of a wide press, as a temperature of the film [K].
  double hidden() const { return hidden_; }

  /// Whether a reading that is `kelvin` above its expectation is in the direction of a press [K].
  bool may_hide(double kelvin) const { return kelvin * per_kelvin_ < 0.0; }

  /// Count a reading of that many deviations [1] at a rate of the temperature [K/s]; 0: it contradicts nothing.
  void count(double deviations, double rate);

  /// Whether zeros are refuted by readings in turn.
  bool in_turn() const { return in_turn_ >= kInTurn; }

  /// Record that zeros have been refuted by a reading [K].
  void refute(double kelvin) { hidden_ = kelvin; }

  /// Process the end of a block: its duration and the time that has been processed [s], the rate of the temperature
  /// [K/s], whether a contact is listed, which shows the force from then on, and whether there has been none for a
  /// while.
  void end_block(double duration, double age, double rate, bool listed, bool rested);

  /// Forget the press.
  void clear() { hidden_ = 0.0; }

private:
  double per_kelvin_;
  bool lag_known_;
  double resting_rate_ = 0.0;  ///< Average rate of the temperature while nothing touches [K/s].
  int in_turn_ = 0;            ///< Number of readings in turn that contradict zeros.
  double hidden_ = 0.0;
};

}  // namespace posfet
