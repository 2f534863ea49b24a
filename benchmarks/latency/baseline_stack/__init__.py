# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Baseline implementation for the same board, written as in a tutorial, to be compared with the stack.

slcan and Notifier of python-can, cantools for every frame, messages filled from lists, one process per node with a
SingleThreadedExecutor, scipy.ndimage for the contacts. It does less than the stack: no loss statistics, no
calibration, no baseline tracking, no contact tracks, no variance.
"""
