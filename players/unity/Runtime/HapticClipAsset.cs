// SPDX-License-Identifier: MIT
using UnityEngine;

namespace Hfx.Haptics
{
    /// <summary>A haptic clip as an asset of the project; the importer makes it of a .hfxclip file.</summary>
    public sealed class HapticClipAsset : ScriptableObject
    {
        [SerializeField, HideInInspector] byte[] bytes;
        HapticClip clip;

        public HapticClip Clip { get { return clip ?? (clip = new HapticClip(bytes)); } }

        public void SetBytes(byte[] file)
        {
            bytes = file;
            clip = null;
        }
    }
}
