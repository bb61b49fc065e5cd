# SPDX-License-Identifier: GPL-3.0-or-later
"""Perceptual models and skins bound to the bodies of a scene, made on first use."""

from __future__ import annotations

from collections.abc import Callable

from ..arrays import I32
from ..body.model import PerceptualModel
from ..counters import Counters
from ..native import library
from ..scene import BodyDescription, SkinBinding, SurfaceBinding
from ..tolerance import Tolerance
from .cell_coverage import BodySkin, SkinCoverage, finer_id
from .posing import BlendedModel, PosableModel, SurfaceModel
from .skinned_model import SkinnedModel


class BoundSkins:
    """Cache of the skins of a scene; ``counters`` count loaded models.

    ``models`` loads a perceptual model by id on first use.
    """

    def __init__(
        self, models: Callable[[str], PerceptualModel], tolerance: Tolerance, counters: Counters
    ) -> None:
        self._load = models
        self._tolerance = tolerance
        self._counters = counters
        self._models: dict[str, PerceptualModel] = {}
        self._skins: dict[tuple[str, str | None], SkinCoverage] = {}
        self._bound: dict[tuple[str, str], BodySkin] = {}

    def of(self, body: BodyDescription, model_id: str) -> BodySkin:
        """Skin of a model bound to a body, cached; by surface anchors, or fitted or canonical skin
        weights."""
        key = (body.id, model_id)
        if key not in self._bound:
            binding = body.binding

            def bind(model: PerceptualModel, clusters: list[I32]) -> PosableModel:
                if isinstance(binding, SurfaceBinding):
                    return SurfaceModel(model, binding.anchors[model.id], clusters)
                fitted = binding.fitted.get(model.id)
                placed = model if fitted is None else fitted.of(model)
                kind = SkinnedModel if library.is_there() else BlendedModel
                return kind(placed, binding, clusters)

            self._bound[key] = BodySkin(self._skin_of(model_id, binding), binding, bind)
        return self._bound[key]

    def _skin_of(self, model_id: str, binding: SkinBinding | SurfaceBinding) -> SkinCoverage:
        """Cached skin coverage of a model, shared by bodies. Sampled on a finer model unless the
        body was fitted without the finer model."""
        model = self.model(model_id)
        # A fitted body has finer skin only if the finer model was fitted too.
        fine = finer_id(model, self._tolerance)
        if isinstance(binding, SurfaceBinding):
            fine = fine if fine in binding.anchors else None
        elif model_id in binding.fitted:
            fine = fine if fine in binding.fitted else None
        if (model_id, fine) not in self._skins:
            finer = None if fine is None else self.model(fine)
            self._skins[model_id, fine] = SkinCoverage(model, self._tolerance, finer)
        return self._skins[model_id, fine]

    def model(self, model_id: str) -> PerceptualModel:
        """Perceptual model by id, not fitted to a body, loaded and counted once."""
        if model_id not in self._models:
            self._models[model_id] = self._load(model_id)
            self._counters.models_loaded.append(model_id)
        return self._models[model_id]
