// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Fuzzing of the compiled path from scans to messages: built with sanitizers by `make sanitize`.
///
/// First it plays touches that repeat, and fails where a scan allocates memory in steady state. Then it makes random
/// scans, of which anything may be wrong, with random estimates or with the ends of blocks, and ends at undefined
/// behaviour, at an access outside of an object, and where what is reported contradicts itself: `fuzz_scan_path SECONDS
/// SEED`.

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

#include "scan_board.hpp"

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

/// What an estimator does at rest: the forces are zero.
void zero(Board& board) {
  ForceIntegration::State& state = board.integration->state();
  for (std::size_t taxel = 0; taxel < state.force.size(); ++taxel) {
    state.correction[taxel] += state.force[taxel];
  }
}

/// The number of allocations of touches that repeat, after the first ones, by the path alone, or (`blocks`) with the
/// ends of blocks; `most` is the greatest number of contacts.
std::size_t allocations_of_touches(Board& board, bool blocks, std::size_t& most) {
  const std::size_t round = blocks ? 4 * kRound : kRound;
  const std::vector<double> variance(board.counts.size(), kNoise * kNoise);
  std::size_t begin = 0;
  for (std::size_t index = 0; index < 16 * round; ++index) {
    if (index == 12 * round) {
      begin = allocations;
    }
    board.next(1000);
    board.temperatures[0] = 25.0F + 0.1F * static_cast<float>(index % 2);
    if (blocks) {
      leaking_touch(board, index);
      board.reconstruct();
    } else {
      touch(board, index);
      board.process();
    }
    most = std::max(most, board.path->contacts().size());
    if (!blocks && index % 16 == 15) {
      board.end_block(variance);
    }
    if (!blocks && (index + 1) % round == 0) {
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

/// What services change between two scans.
void fuzz_services(Board& board, Anything& any, std::vector<double>& change) {
  board.block_end->detects_faults = any.chance(0.8);
  if (any.chance(0.3)) {
    board.hum =
        std::make_shared<MainsHum>(board.counts.size(), any.chance(0.5) ? kScanRate : 0.0, kNoise * kChargePerNewton);
    board.block_end->set_hum(board.hum);
  }
  if (any.chance(0.5)) {
    board.estimator->tare(any.chance(0.5), change.data());
  }
  board.finder->thresholds().set({any.chance(0.5) ? kThreshold : 3.0 * kThreshold, 0.01});
  board.block_end->set_thresholds();
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
  const bool blocks = any.chance(0.5);
  for (std::size_t index = 0; index < scans; ++index) {
    fuzz_scan(board, any, index);
    if (blocks) {
      board.reconstruct();
    } else {
      board.process();
    }
    accepted += board.path->result().accepted ? 1 : 0;
    if (any.chance(blocks ? 0.01 : 0.05)) {
      blocks ? fuzz_services(board, any, values) : fuzz_estimates(board, any, values);
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
    const std::size_t found = allocations_of_touches(board, false, most);
    std::cout << "fuzz_scan_path: " << rows << " x " << cols << ": " << found << " allocations, up to " << most
              << " contacts\n";
    require(found == 0, "a scan allocates in steady state");
    require(most > 1, "there were not two contacts");
    Board closed(rows, cols, share, share > 0.0);
    most = 0;
    const std::size_t of_blocks = allocations_of_touches(closed, true, most);
    std::cout << "fuzz_scan_path: " << rows << " x " << cols << ", with the ends of blocks: " << of_blocks
              << " allocations, up to " << most << " contacts\n";
    require(of_blocks == 0, "the end of a block allocates in steady state");
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
