// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Threads around a sink: one takes scans, and closes blocks, while others do what services and diagnostics do with the
/// mutex held. Built with ThreadSanitizer, which ends it at a race: `race_sink SCANS`.

#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <mutex>
#include <thread>
#include <vector>

#include "posfet_core/contacts_sink.hpp"
#include "scan_board.hpp"

namespace posfet {

namespace {

std::atomic<std::uint64_t> published{0};

int publish(const void* /*publisher*/, const SerializedMessage* message, void* /*allocation*/) {
  published += message->length > 0 ? 1 : 0;
  return 0;
}

/// What services change, and what diagnostics read.
void serve(Board& board, std::mutex& mutex, const std::atomic<bool>& ended) {
  std::vector<double> values(board.counts.size());
  for (std::uint64_t round = 0; !ended; ++round) {
    const std::scoped_lock lock(mutex);
    switch (round % 5) {
      case 0:
        board.reconstructor->run_maintenance();
        board.estimator->tare(round % 2 == 0, values.data());
        board.block_end->set_thresholds();
        break;
      case 1:
        board.block_end->detects_faults = round % 3 == 0;
        board.block_end->set_hum(std::make_shared<MainsHum>(values.size(), kScanRate, kNoise * kChargePerNewton));
        break;
      case 2:
        board.finder->thresholds().set({kThreshold, 0.01});
        board.path->vibration_wanted = round % 2 == 0;
        break;
      default:
        board.estimator->variance(values.data());
        for (std::size_t taxel = 0; taxel < values.size(); ++taxel) {
          require(std::isfinite(board.estimator->force()[taxel]), "a force is not finite");
          require(values[taxel] > 0.0, "a variance is not positive");
        }
        for (const Contact& contact : board.path->contacts()) {
          require(!contact.region.taxels.empty(), "a contact has no taxel");
        }
    }
  }
}

/// Give the scans of touches to the sink, as a loop does.
void scan(Board& board, ContactsSink& sink, std::uint64_t scans) {
  for (std::uint64_t index = 0; index < scans; ++index) {
    board.next(1000);
    leaking_touch(board, index);
    require(sink.take(board.scan) == Taken::kTaken, "a scan was not taken");
  }
}

}  // namespace

}  // namespace posfet

int main(int count, char** arguments) {
  const std::uint64_t scans = count > 1 ? std::strtoull(arguments[1], nullptr, 10) : 20000;
  posfet::Board board(5, 5, 0.0, false);
  std::mutex mutex;
  std::atomic<bool> ended{false};
  posfet::ContactsSink sink(*board.reconstructor, board.writer, mutex);
  posfet::Publishing publishing;
  publishing.publish = &posfet::publish;
  publishing.publisher = &board;
  sink.set_publishing(publishing);
  std::thread service([&] { posfet::serve(board, mutex, ended); });
  std::thread loop([&] { posfet::scan(board, sink, scans); });
  loop.join();
  ended = true;
  service.join();
  posfet::require(posfet::published == scans, "a scan was not published");
  std::cout << "race_sink: " << scans << " scans, no race\n";
  return 0;
}
