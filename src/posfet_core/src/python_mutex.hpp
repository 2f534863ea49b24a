// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// A mutex for Python: a context manager, which waits without the interpreter.
#pragma once

#include <pybind11/pybind11.h>

#include <mutex>

namespace posfet {

/// Acquire a mutex in a thread of Python. Its owner may need the interpreter before it releases it.
inline void acquire(std::mutex& mutex) {
  if (!mutex.try_lock()) {
    const pybind11::gil_scoped_release waiting;
    mutex.lock();
  }
}

}  // namespace posfet
