# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Where a result is valid, and in plain phrases why not, for one design or for thousands at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posfet_model._lib.types import Mask


@dataclass(frozen=True, eq=False)
class Validity:
    """Reasons why designs or results are not valid, each with the mask of those that it concerns; unchecked."""

    findings: Mapping[str, Mask]
    """Mask by reason; all masks broadcast together."""

    @property
    def valid(self) -> Mask:
        """Where there is no reason against it, of the broadcast shape of the masks."""
        masks = np.broadcast_arrays(*self.findings.values()) if self.findings else [np.zeros((), np.bool_)]
        return np.asarray(~np.logical_or.reduce(masks))

    @property
    def reasons(self) -> list[str]:
        """Reasons that concern any of the designs; of a single design, its reasons."""
        return [reason for reason, mask in self.findings.items() if np.any(mask)]

    def reasons_at(self, *index: int) -> list[str]:
        """Return the reasons that concern one design; unchecked.

        Parameters
        ----------
        *index : int
            Position of the design in the broadcast shape.

        Returns
        -------
        list of str
            The reasons.
        """
        shape = self.valid.shape
        return [reason for reason, mask in self.findings.items() if np.broadcast_to(mask, shape)[index]]

    def also(self, findings: Mapping[str, Mask]) -> Validity:
        """Return the validity with further findings; those under the same reason are joined. Unchecked.

        Parameters
        ----------
        findings : mapping of str to ndarray
            Mask by reason.

        Returns
        -------
        Validity
            All findings.
        """
        joined = dict(self.findings)
        for reason, mask in findings.items():
            joined[reason] = joined[reason] | mask if reason in joined else mask
        return Validity(joined)
