// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Fuzzing of the compiled path from scans to messages: built with sanitizers by `make sanitize`.
///
/// First it plays touches that repeat, and fails where a scan allocates memory in steady state. Then it makes random
/// scans and estimates, of which anything may be wrong, and ends at undefined behaviour, at an access outside of an
/// object, and where what is reported contradicts itself: `fuzz_scan_path SECONDS SEED`.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <memory>
#include <new>
#include <random>
#include <vector>

#include "posfet_core/contacts_cdr.hpp"
#include "posfet_core/scan_path.hpp"

namespace {

std::size_t allocations = 0;

void* counted(std::size_t bytes) {
  ++allocations;
  void* const block = std::malloc(bytes == 0 ? 1 : bytes);
  if (block == nullptr) {
    throw std::bad_alloc();
  }
  return block;
}

}  // namespace

void* operator new(std::size_t bytes) { return counted(bytes); }
void* operator new[](std::size_t bytes) { return counted(bytes); }
void operator delete(void* block) noexcept { std::free(block); }
void operator delete[](void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t /*bytes*/) noexcept { std::free(block); }
void operator delete[](void* block, std::size_t /*bytes*/) noexcept { std::free(block); }

namespace posfet {

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kPitch = 1.5e-3;
constexpr double kChargePerNewton = 3e-5;
constexpr double kNoise = 3.4e-4;
constexpr double kThreshold = 0.02;
constexpr double kCountsPerNewton = 2000.0;
constexpr std::size_t kCauses = 3;
constexpr std::uint64_t kLayout = 7;

void require(bool holds, const char* what) {
  if (!holds) {
    std::cerr << "fuzz_scan_path: " << what << '\n';
    std::exit(1);
  }
}

/// An array with all parts of its path, and one scan.
struct Board {
  Layout layout;
  std::shared_ptr<HumFilter> hum;
  std::shared_ptr<BurstDetector> bursts;
  std::shared_ptr<ForceIntegration> integration;
  std::shared_ptr<CountHistory> history;
  std::shared_ptr<ContactFinder> finder;
  std::unique_ptr<ScanPath> path;
  ContactsWriter writer;
  std::vector<std::uint16_t> counts;
  std::vector<float> temperatures;
  Scan scan;

  Board(Taxel rows, Taxel cols, double share, bool bent)
      : layout{rows, cols, kPitch, kPitch, 1e-6},
        writer({"finger", 7, "posfet", kThreshold, 0.01, Surface{bent ? 8e-3 : kInf, rows > cols}}),
        counts(static_cast<std::size_t>(rows * cols), 32768),
        temperatures{25.0F, 25.0F} {
    const std::size_t taxels = counts.size();
    hum = std::make_shared<HumFilter>(taxels, 20);
    bursts = std::make_shared<BurstDetector>(SkinResponse(layout, 0.13, 0.13), 0.01 * kChargePerNewton, 1e-15,
                                             kChargePerNewton);
    integration = std::make_shared<ForceIntegration>(
        std::vector<double>(taxels, 0.27), std::vector<double>(taxels, 1.0 / kChargePerNewton),
        std::vector<double>(taxels, -1.0), IntegrationLimits{0.01, 0.02, 0.006, 3.0, 1e-3}, kCauses);
    history = std::make_shared<CountHistory>(66, taxels);
    finder = std::make_shared<ContactFinder>(layout, 0.6e-3, ContactThresholds{kThreshold, 0.01});
    ScanParts parts{
        std::make_shared<ScanClock>(kLayout, taxels, 0.27, 1000.0),
        std::make_shared<CrosstalkCompensator>(layout, share),
        bursts,
        hum,
        integration,
        history,
        finder,
        std::make_shared<ContactTracker>(TrackerSettings{1.5, 0.02, 2e-3, 1e-3, kPitch, kThreshold, kNoise}, 1),
        std::make_shared<DynamicChannel>(layout, kNoise)};
    // One volt for each newton.
    const InverseSignalChain chain{
        -32768.0 / kCountsPerNewton, 1.0 / kCountsPerNewton, 1.0, 0.0, kChargePerNewton, 300, 65200};
    path = std::make_unique<ScanPath>(parts, chain, std::vector<double>(taxels, 1e-9), 5.0 * kNoise);
    scan.layout = kLayout;
    scan.stamp = 1'700'000'000'000'000'000;
    scan.counts = counts.data();
    scan.taxels = taxels;
    scan.temperatures = temperatures.data();
    scan.sensors = temperatures.size();
  }

  void next(std::int64_t step) {
    ++scan.sequence;
    scan.device_time += step;
    scan.stamp += 1000 * step;
  }

  /// Process the scan, and check what is reported.
  void process() {
    if (path->receive(scan) && !path->begin(scan)) {
      integration->inverse().start(path->charge().data());
      ForceIntegration::State& state = integration->state();
      state.correction = state.raw;
      state.force.assign(state.force.size(), 0.0);
      integration->block().started = integration->block().valid = true;
    }
    path->finish();
    const ScanResult& result = path->result();
    const std::vector<std::uint8_t>& message = writer.write(result.stamp, result.sequence, result.valid,
                                                            path->contacts(), path->shows_released(), path->motions());
    require(message.size() > 40, "a message is too short");
    TrackId last = 0;
    for (const Contact& contact : path->contacts()) {
      require(contact.id > last, "ids of contacts do not ascend");
      last = contact.id;
      require(!contact.region.taxels.empty(), "a contact has no taxel");
      for (const Taxel taxel : contact.region.taxels) {
        require(taxel >= 0 && static_cast<std::size_t>(taxel) < counts.size(), "a taxel is outside of the array");
      }
    }
    for (const auto& [id, motion] : path->motions()) {
      require(id <= last, "a motion belongs to no contact");
    }
    require(path->clock().step() > 0.0, "a step is not positive");
  }

  /// What the end of a block sets, with given variances and thresholds by them.
  void end_block(const std::vector<double>& variance) {
    const ForceIntegration::State& state = integration->state();
    finder->thresholds().update(state.force.data(), variance.data(), state.offset_known.data());
    path->set_variance(variance.data());
    integration->start_block(true);
    history->keep(2);
    if (hum->state().filled == hum->scans()) {
      hum->start_window();
    }
  }
};

/// Number of scans of a press, slide, merge, split and release of two fingers.
constexpr std::size_t kRound = 512;

/// The scan of a press, slide, merge, split and release of two fingers that repeats after `kRound` scans.
void touch(Board& board, std::size_t number) {
  const std::size_t index = number % kRound;
  const double phase = static_cast<double>(index) / static_cast<double>(kRound);
  const double force = phase < 0.8 ? 0.8 : 0.0;
  const double apart = kPitch * (1.5 + 1.4 * std::sin(6.283185307179586 * phase));
  for (Taxel taxel = 0; taxel < static_cast<Taxel>(board.counts.size()); ++taxel) {
    const Point& at = board.finder->grid().position(taxel);
    double total = 0.0;
    for (const double side : {-1.0, 1.0}) {
      const double dx = at.x - side * apart;
      const double dy = at.y - 1e-3 * phase;
      total += force * std::exp(-(dx * dx + dy * dy) / (2.0 * 0.9e-3 * 0.9e-3));
    }
    const double flicker = static_cast<double>((index * 7 + static_cast<std::size_t>(taxel) * 13) % 3) - 1.0;
    board.counts[static_cast<std::size_t>(taxel)] =
        static_cast<std::uint16_t>(32768.0 + std::round(kCountsPerNewton * total + flicker));
  }
}

/// What an estimator does at rest: the forces are zero.
void zero(Board& board) {
  ForceIntegration::State& state = board.integration->state();
  for (std::size_t taxel = 0; taxel < state.force.size(); ++taxel) {
    state.correction[taxel] += state.force[taxel];
  }
}

/// The number of allocations of touches that repeat, after the first ones; `most` is the greatest number of contacts.
std::size_t allocations_of_touches(Board& board, std::size_t& most) {
  constexpr std::size_t kRounds = 8;
  constexpr std::size_t kFirst = 4;
  const std::vector<double> variance(board.counts.size(), kNoise * kNoise);
  std::size_t begin = 0;
  for (std::size_t index = 0; index < kRounds * kRound; ++index) {
    if (index == kFirst * kRound) {
      begin = allocations;
    }
    board.next(1000);
    touch(board, index);
    board.temperatures[0] = 25.0F + 0.1F * static_cast<float>(index % 2);
    board.process();
    most = std::max(most, board.path->contacts().size());
    if (index % 16 == 15) {
      board.end_block(variance);
    }
    if ((index + 1) % kRound == 0) {
      zero(board);
    }
  }
  return allocations - begin;
}

/// Numbers of any kind.
class Anything {
public:
  explicit Anything(std::uint64_t seed) : random_(seed) {}

  std::uint64_t bits() { return random_(); }
  std::size_t below(std::size_t count) { return static_cast<std::size_t>(random_() % count); }
  bool chance(double probability) { return uniform_(random_) < probability; }

  double value(double scale) {
    if (chance(special_)) {
      const double kinds[] = {0.0, -0.0, kNan, kInf, -kInf, 1e308, -1e308, 5e-324, 1.0, -1.0};  // NOLINT
      return kinds[below(10)];
    }
    return scale * normal_(random_);
  }

  void fill(std::vector<double>& values, double scale) {
    for (double& each : values) {
      each = value(scale);
    }
  }

  void set_special(double share) { special_ = share; }

private:
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> uniform_{0.0, 1.0};
  std::normal_distribution<double> normal_{0.0, 1.0};
  double special_ = 0.0;
};

/// Another scan, of which anything may be wrong.
void fuzz_scan(Board& board, Anything& any, std::size_t index) {
  Scan& scan = board.scan;
  board.next(1000);
  touch(board, index);
  scan.status = 0;
  scan.taxels = board.counts.size();
  scan.layout = kLayout;
  switch (any.below(16)) {
    case 0:
      scan.sequence = any.bits() >> any.below(64);
      break;
    case 1:
      scan.stamp = static_cast<std::int64_t>(any.bits() >> any.below(64));
      break;
    case 2:
      scan.device_time = static_cast<std::int64_t>(any.bits() >> any.below(64));
      break;
    case 3:
      scan.status = static_cast<std::uint32_t>(any.bits());
      break;
    case 4:
      for (std::uint16_t& each : board.counts) {
        each = static_cast<std::uint16_t>(any.bits());
      }
      break;
    case 5:
      board.counts.assign(board.counts.size(), static_cast<std::uint16_t>(any.bits()));
      break;
    case 6:
      board.counts[any.below(board.counts.size())] = static_cast<std::uint16_t>(any.bits());
      break;
    case 7:
      board.temperatures.assign(any.below(5), static_cast<float>(any.value(30.0)));
      scan.temperatures = board.temperatures.data();
      scan.sensors = board.temperatures.size();
      break;
    case 8:
      scan.taxels = any.below(2) == 0 ? 0 : board.counts.size() - 1;
      break;
    case 9:
      scan.layout = any.bits();
      break;
    default:
      break;
  }
}

/// Estimates of which anything may be wrong.
void fuzz_estimates(Board& board, Anything& any, std::vector<double>& values) {
  ForceIntegration::State& state = board.integration->state();
  any.fill(state.correction, 0.01);
  any.fill(state.rate, 0.01);
  any.fill(state.correlated_error, 1e-3);
  TaxelFlags unlisted(values.size());
  TaxelFlags interpolated(values.size());
  for (std::size_t taxel = 0; taxel < values.size(); ++taxel) {
    state.offset_known[taxel] = any.chance(0.95);
    state.ignored[taxel] = unlisted[taxel] = any.chance(0.1);
    interpolated[taxel] = unlisted[taxel] && any.chance(0.5);
  }
  board.path->set_faulty(unlisted.data(), interpolated.data());
  board.path->vibration_wanted = any.chance(0.3);
  any.fill(board.hum->parts(), 1e-7);
  board.hum->state().present = any.chance(0.3);
  board.hum->state().frequency = any.value(50.0);
  any.fill(values, 1e-4);
  board.bursts->set_usual_change(values.data());
  if (any.chance(0.5)) {
    Taxels watched;
    for (std::size_t taxel = 0; taxel < values.size(); ++taxel) {
      if (any.chance(0.5)) {
        watched.push_back(static_cast<Taxel>(taxel));
      }
    }
    board.integration->watch(watched, values.data(), any.value(0.5));
  } else {
    board.integration->watch_none();
  }
  any.fill(values, 1e-6);
  board.end_block(values);
}

/// Fuzz one array; the number of scans that were accepted.
std::uint64_t fuzz(Anything& any, std::size_t scans) {
  std::uint64_t accepted = 0;
  const auto size = [&] { return static_cast<Taxel>(1 + any.below(any.chance(0.1) ? 64 : 9)); };
  Board board(size(), size(), any.chance(0.5) ? 0.2 * static_cast<double>(any.below(101)) / 100.0 : 0.0,
              any.chance(0.5));
  const double shares[] = {0.0, 0.0, 0.01, 0.3};  // NOLINT
  any.set_special(shares[any.below(4)]);
  std::vector<double> values(board.counts.size());
  for (std::size_t index = 0; index < scans; ++index) {
    fuzz_scan(board, any, index);
    board.process();
    accepted += board.path->result().accepted ? 1 : 0;
    if (any.chance(0.05)) {
      fuzz_estimates(board, any, values);
    }
  }
  return accepted;
}

/// Fail where scans allocate in steady state, on arrays of several sizes.
void test_steady_state() {
  struct Size {
    Taxel rows;
    Taxel cols;
    double share;
  };
  for (const auto& [rows, cols, share] : std::vector<Size>{{5, 5, 0.0}, {5, 5, 0.05}, {16, 16, 0.02}, {1, 9, 0.0}}) {
    Board board(rows, cols, share, share > 0.0);
    board.integration->state().offset_known = TaxelFlags(board.counts.size(), true);
    std::size_t most = 0;
    const std::size_t found = allocations_of_touches(board, most);
    std::cout << "fuzz_scan_path: " << rows << " x " << cols << ": " << found << " allocations, up to " << most
              << " contacts\n";
    require(found == 0, "a scan allocates in steady state");
    require(most > 1, "there were not two contacts");
  }
}

/// Fuzz for some seconds; the number of scans that were accepted.
std::uint64_t fuzz_for(double seconds, std::uint64_t seed, std::uint64_t& scans) {
  constexpr std::size_t kScans = 200;
  Anything any(seed);
  std::uint64_t accepted = 0;
  const auto begin = std::chrono::steady_clock::now();
  while (std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < seconds) {
    accepted += fuzz(any, kScans);
    scans += kScans;
  }
  return accepted;
}

}  // namespace

}  // namespace posfet

int main(int count, char** arguments) {
  const double seconds = count > 1 ? std::strtod(arguments[1], nullptr) : 10.0;
  const std::uint64_t seed = count > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1;
  std::cerr << "fuzz_scan_path: seed " << seed << '\n';
  posfet::test_steady_state();
  std::uint64_t scans = 0;
  const std::uint64_t accepted = posfet::fuzz_for(seconds, seed, scans);
  std::cout << "fuzz_scan_path: " << scans << " scans, " << accepted << " accepted, no failure\n";
  return accepted > 0 ? 0 : 1;
}
