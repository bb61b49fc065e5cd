// SPDX-License-Identifier: MIT
using System;
using System.IO;
using UnityEditor.AssetImporters;
using UnityEngine;

namespace Hfx.Haptics.Editor
{
    /// <summary>Makes a <see cref="HapticClipAsset"/> of each .hfxclip file of the project.</summary>
    [ScriptedImporter(1, "hfxclip")]
    public sealed class HapticClipImporter : ScriptedImporter
    {
        public override void OnImportAsset(AssetImportContext context)
        {
            byte[] bytes = File.ReadAllBytes(context.assetPath);
            try
            {
                new HapticClip(bytes);
            }
            catch (FormatException fault)
            {
                context.LogImportError(context.assetPath + ": " + fault.Message);
                return;
            }
            HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
            asset.SetBytes(bytes);
            context.AddObjectToAsset("clip", asset);
            context.SetMainObject(asset);
        }
    }
}
