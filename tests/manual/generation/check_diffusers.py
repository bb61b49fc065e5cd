# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the back end ``diffusers`` and ``train-decoder``, apart from pytest.

``pip install -e ".[generate]"``, then ``python tests/manual/generation/check_diffusers.py``. There
are no weights: models of the same classes as Stable Diffusion 1.5, XL and 3 are made here from
small configurations, tokenizer included, so everything is run but pictures show nothing real.
``--steps`` sets the length of the decoder's training (600, some minutes of a processor).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from diffusers import (
    AutoencoderKL,
    DDIMScheduler,
    FlowMatchEulerDiscreteScheduler,
    SD3Transformer2DModel,
    StableDiffusion3Pipeline,
    StableDiffusionPipeline,
    StableDiffusionXLPipeline,
    UNet2DConditionModel,
)
from transformers import CLIPTextConfig, CLIPTextModel, CLIPTextModelWithProjection, CLIPTokenizer

from hfx_blender.errors import InputError
from hfx_blender.generation import generated
from hfx_tools.diffusion import decoder_pairs, diffusion, touch_decoder
from hfx_tools.diffusion.decoder_training import DecoderTraining, TrainingSettings
from hfx_tools.diffusion.model_folder import CancelledError, Latents, ModelFolder, check_folder

TEXELS = 64
PAIRS = decoder_pairs.LibraryPairs(TEXELS, count=4000)
HELD_OUT = range(100_000, 100_032)  # numbers never used in training


def tokenizer(folder: Path) -> CLIPTokenizer:
    letters = [chr(k) for k in range(33, 127)]
    words = letters + [f"{letter}</w>" for letter in letters] + ["<|startoftext|>", "<|endoftext|>"]
    folder.mkdir(parents=True)
    (folder / "vocab.json").write_text(json.dumps({item: k for k, item in enumerate(words)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    return CLIPTokenizer(
        str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=77
    )


def text_encoder(vocabulary: int, *, projected: bool = False) -> Any:
    config = CLIPTextConfig(
        vocab_size=vocabulary, hidden_size=32, intermediate_size=37, num_attention_heads=4,
        num_hidden_layers=3, projection_dim=32, bos_token_id=vocabulary - 2,
        eos_token_id=vocabulary - 1, pad_token_id=1,
    )  # fmt: skip
    return (CLIPTextModelWithProjection if projected else CLIPTextModel)(config)


def vae(channels: int = 4, *, quantized: bool = True) -> AutoencoderKL:
    return AutoencoderKL(
        block_out_channels=(16, 32), latent_channels=channels, norm_num_groups=8,
        sample_size=TEXELS,
        down_block_types=("DownEncoderBlock2D",) * 2, up_block_types=("UpDecoderBlock2D",) * 2,
        use_quant_conv=quantized, use_post_quant_conv=quantized,
    )  # fmt: skip


def unet(**more: Any) -> UNet2DConditionModel:
    return UNet2DConditionModel(
        block_out_channels=(16, 32), layers_per_block=1, sample_size=TEXELS // 2, norm_num_groups=8,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
        up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"), attention_head_dim=4, **more,
    )  # fmt: skip


def stable_diffusion(folder: Path) -> Path:
    words = tokenizer(folder / "words")
    StableDiffusionPipeline(
        vae=vae(), text_encoder=text_encoder(len(words)), tokenizer=words,
        unet=unet(cross_attention_dim=32), scheduler=DDIMScheduler(clip_sample=False),
        safety_checker=None, feature_extractor=None, requires_safety_checker=False,
    ).save_pretrained(folder / "sd15")  # fmt: skip
    return folder / "sd15"


def stable_diffusion_xl(folder: Path) -> Path:
    words = tokenizer(folder / "words_xl")
    StableDiffusionXLPipeline(
        vae=vae(), tokenizer=words, tokenizer_2=words, text_encoder=text_encoder(len(words)),
        text_encoder_2=text_encoder(len(words), projected=True),
        unet=unet(
            cross_attention_dim=64, addition_embed_type="text_time", addition_time_embed_dim=8,
            projection_class_embeddings_input_dim=80, transformer_layers_per_block=1,
        ),
        scheduler=DDIMScheduler(clip_sample=False),
    ).save_pretrained(folder / "sdxl")  # fmt: skip
    return folder / "sdxl"


def stable_diffusion_3(folder: Path) -> Path:
    words = tokenizer(folder / "words_3")
    StableDiffusion3Pipeline(
        vae=vae(16, quantized=False), tokenizer=words, tokenizer_2=words, tokenizer_3=None,
        text_encoder=text_encoder(len(words), projected=True),
        text_encoder_2=text_encoder(len(words), projected=True), text_encoder_3=None,
        transformer=SD3Transformer2DModel(
            sample_size=TEXELS // 2, patch_size=2, in_channels=16, out_channels=16, num_layers=1,
            attention_head_dim=8, num_attention_heads=4, joint_attention_dim=64,
            caption_projection_dim=32, pooled_projection_dim=64, pos_embed_max_size=64,
        ),
        scheduler=FlowMatchEulerDiscreteScheduler(),
    ).save_pretrained(folder / "sd3")  # fmt: skip
    return folder / "sd3"


def check_a_model(folder: Path, out: Path) -> None:
    """Seeds, sizes, two decodings of the same latents, tiling, record, cancelling."""
    settings = diffusion.Settings(texels=TEXELS, steps=3)
    model = ModelFolder(folder, "cpu")
    decoder = touch_decoder.from_vae(model.vae)
    touch_decoder.save(decoder, out / "decoder", {})
    decoder = touch_decoder.load(out / "decoder", model.vae, tiling=True)
    shares: list[float] = []
    first, again, second = (
        diffusion.generate(
            model, "old wood", seed=seed, settings=settings, decoder=decoder,
            decoder_folder=out / "decoder", progress=shares.append,
        )
        for seed in (1, 1, 2)
    )  # fmt: skip
    assert np.array_equal(first.colour, again.colour)
    assert not np.array_equal(first.colour, second.colour)
    assert first.colour.shape == (TEXELS, TEXELS, 3) and first.map.intensity.shape == (TEXELS,) * 2
    assert shares[:3] == [1 / 3, 2 / 3, 1.0]
    # Before training, the new decoder is the mean of the colour decoder's channels.
    latents = Latents(torch.randn(1, model.vae.config.latent_channels, 32, 32))
    with torch.no_grad():
        colours = model.vae.decode(model.unscaled(latents)).sample
        touch = decoder(model.unscaled(latents))
        torch.testing.assert_close(touch, colours.mean(1, keepdim=True), rtol=1e-4, atol=1e-5)
        # Decoding wraps: a shift of the latents is the same shift of the picture.
        rolled = model.vae.decode(torch.roll(model.unscaled(latents), (5, 9), (2, 3))).sample
        unit = model.texels_per_latent
        torch.testing.assert_close(
            rolled, torch.roll(colours, (5 * unit, 9 * unit), (2, 3)), rtol=1e-3, atol=1e-4
        )
    written = generated.write(first, out / "made", "check")
    record = json.loads(written.files[-1].read_text())
    assert record["back_end"] == "diffusers" and record["decoder_sha256"] and record["seed"] == 1
    assert generated.read(written.files[-1]).relief.slope is not None

    def cancelled() -> bool:
        return len(shares) > 9

    try:
        diffusion.generate(
            model, "x", settings=settings, progress=shares.append, is_cancelled=cancelled
        )
        raise AssertionError("it was not cancelled")
    except CancelledError:
        assert len(shares) == 10


def check_tiling_of_a_unet(folder: Path) -> None:
    """Shifted noise gives the shifted picture: there is no edge anywhere."""
    model = ModelFolder(folder, "cpu")
    noise = torch.randn(1, 4, 32, 32, generator=torch.Generator().manual_seed(0))

    def picture(noise: Any) -> Any:
        return model.pipeline(
            "wood", height=TEXELS, width=TEXELS, num_inference_steps=3, latents=noise,
            output_type="latent",
        ).images  # fmt: skip

    moved = torch.roll(noise, (8, 12), (2, 3))
    apart = (torch.roll(picture(noise), (8, 12), (2, 3)) - picture(moved)).abs().max()
    model.make_tiling()
    near = (torch.roll(picture(noise), (8, 12), (2, 3)) - picture(moved)).abs().max()
    assert near < 1e-3 < apart, (near, apart)


def check_what_is_refused(folder: Path, out: Path) -> None:
    """Refused: pickles, code of a model, missing parts, mismatched sizes."""

    def refused(change: Callable[[Path], Any], told: str) -> None:
        import shutil

        copy = out / "refused"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(folder, copy)
        change(copy)
        try:
            check_folder(copy)
            ModelFolder(copy, "cpu")
        except InputError as error:
            assert told in str(error), error
        else:
            raise AssertionError(f"not refused: {told}")

    index = "model_index.json"
    document = json.loads((folder / index).read_text())
    refused(lambda f: (f / index).unlink(), "model_index.json")
    for kind in (["own_code", "Model"], ["diffusers", "NoModel"], ["transformers", "BertModel"]):
        told = kind[0] if kind[0] == "own_code" else kind[1]
        changed = json.dumps(document | {"unet": kind})
        refused(lambda f, text=changed: (f / index).write_text(text), told)
    refused(lambda f: (f / "tokenizer" / "vocab.json").write_text("[]"), "cannot be loaded")
    refused(
        lambda f: (f / "text_encoder" / "model.safetensors").write_bytes(b"x" * 100),
        "cannot be loaded",
    )
    weights = "diffusion_pytorch_model"
    refused(
        lambda f: (f / "unet" / f"{weights}.safetensors").rename(f / "unet" / f"{weights}.bin"),
        "pickle",
    )
    refused(lambda f: (f / "unet" / "modeling.py").write_text("1"), "is code")
    refused(lambda f: (f / "vae" / f"{weights}.safetensors").unlink(), "cannot be loaded")
    try:
        ModelFolder(folder, "cpu").latents("x", "", 0, 62, steps=1, guidance=1.0, tiling=True)
        raise AssertionError("62 texels were taken")
    except InputError as error:
        assert "multiple of 4" in str(error)


def check_going_on(out: Path) -> None:
    """Interrupted and continued training gives the weights of uninterrupted training."""
    created = vae()
    settings = TrainingSettings(steps=4, warm_up=2, saved_every=100)
    whole = DecoderTraining(created, PAIRS, out / "whole", settings)
    whole.run()
    first = DecoderTraining(created, PAIRS, out / "parts", settings)
    first.run(is_cancelled=lambda: first.step == 2)
    assert first.step == 2
    rest = DecoderTraining(created, PAIRS, out / "parts", settings)
    assert rest.step == 2
    rest.run()
    pairs = zip(
        whole.decoder.state_dict().values(), rest.decoder.state_dict().values(), strict=True
    )
    assert all(torch.equal(a, b) for a, b in pairs)


def trained_vae(steps: int) -> AutoencoderKL:
    """A VAE trained briefly on the library's pictures, so that decoded pictures have a meaning."""
    torch.manual_seed(0)
    created = vae()
    adam = torch.optim.Adam(created.parameters(), 1e-3)
    for step in range(steps):
        rng = np.random.default_rng([9, step])
        colours = [PAIRS[int(k)][0] for k in rng.integers(len(PAIRS), size=4)]
        picture = torch.from_numpy(np.stack(colours))
        latent_dist = created.encode(picture).latent_dist
        loss = (
            created.decode(latent_dist.sample()).sample - picture
        ).abs().mean() + 1e-6 * latent_dist.kl().mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
    return created.eval()


def check_a_trained_decoder(out: Path, steps: int) -> dict[str, float]:
    """MSE on held-out latents: of the decoder, of the mean map, of Sobel of the decoded picture."""
    created = trained_vae(steps)
    settings = TrainingSettings(
        steps=steps, learning_rate=5e-4, warm_up=min(500, steps // 4), saved_every=10**9
    )
    training = DecoderTraining(created, PAIRS, out / "trained", settings)
    before = training.errors(PAIRS, HELD_OUT)
    training.run()
    after = training.errors(PAIRS, HELD_OUT)
    mean = np.mean([0.5 + 0.5 * PAIRS[k][1] for k in range(200)], axis=0)
    of_mean, of_sobel = [], []
    for number in HELD_OUT:
        colours, truth = PAIRS[number]
        share = 0.5 + 0.5 * truth[0]
        of_mean.append(float(np.square(mean[0] - share).mean()))
        with torch.no_grad():
            latents = training.encoded(torch.from_numpy(colours[None]))
            decoded = created.decode(latents).sample[0].clamp(-1, 1).numpy()
        picture = (0.5 + 0.5 * decoded).transpose(1, 2, 0)[::-1].astype(np.float64)
        actual = decoder_pairs.map_of_picture(picture)[::-1]
        of_sobel.append(float(np.square(actual - share).mean()))
    return {
        "untrained": before["mse"],
        "trained": after["mse"],
        "perceptual_before": before["perceptual_distance"],
        "perceptual_after": after["perceptual_distance"],
        "mean map": float(np.mean(of_mean)),
        "Sobel of the decoded picture": float(np.mean(of_sobel)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=600)
    arguments = parser.parse_args()
    torch.manual_seed(0)
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for make in (stable_diffusion, stable_diffusion_xl, stable_diffusion_3):
            model = make(folder)
            check_a_model(model, folder / f"out_{model.name}")
            say(f"{model.name}: ok")
        check_tiling_of_a_unet(folder / "sd15")
        say("tiling of a UNet: ok")
        check_what_is_refused(folder / "sd15", folder)
        say("what is refused: ok")
        check_going_on(folder)
        say("going on after an interruption: ok")
        trained_decoder = check_a_trained_decoder(folder, arguments.steps)
        say("\n".join(f"  {key}: {value:.5f}" for key, value in trained_decoder.items()))
        assert trained_decoder["trained"] < trained_decoder["mean map"]
        assert trained_decoder["trained"] < trained_decoder["Sobel of the decoded picture"]
        say(f"trained decoder: ok ({time.process_time() - begin:.0f} s of a processor in all)")


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
