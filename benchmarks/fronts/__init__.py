# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Run time against error of each stage and of the whole pipeline: `make fronts`.

One module per stage, each with `measure(effort)`, which returns its fronts; `front` is what they have in common,
`chart` draws one, `page` writes docs/runtime_accuracy.md. A front with a check that fails ends the run.
"""
