// SPDX-License-Identifier: MIT
using System.Collections.Generic;
using UnityEditor;
using UnityEngine;

namespace Hfx.Haptics.Editor
{
    /// <summary>Creates a <see cref="HapticVolume"/> for each volume effect of a clip.</summary>
    public static class VolumeCreation
    {
        const string Name = "Create Volumes from the Clip";

        [MenuItem("CONTEXT/HapticBody/" + Name)]
        static void Create(MenuCommand command)
        {
            HapticBody body = (HapticBody)command.context;
            if (body.EffectClip == null) Debug.LogError("Choose a clip first.", body);
            else Create(body.EffectClip);
        }

        [MenuItem("CONTEXT/HapticClipAsset/" + Name)]
        static void CreateOfAsset(MenuCommand command) { Create(((HapticClipAsset)command.context).Clip); }

        /// <summary>
        /// Makes an object for each volume effect, with the place and size of the volume in Blender's scene, below the
        /// object or bone with the name of the effect where the open scenes have one. Effects that a volume has already
        /// are left as they are. Returns the new volumes; one step of Undo takes them back.
        /// </summary>
        public static List<HapticVolume> Create(HapticClip clip)
        {
            List<HapticVolume> created = new List<HapticVolume>();
            HashSet<string> present = new HashSet<string>();
            foreach (HapticVolume volume in Object.FindObjectsOfType<HapticVolume>()) present.Add(volume.Effect);
            Undo.SetCurrentGroupName(Name);
            foreach (Effect effect in clip.Effects)
            {
                if (effect.IsPainted || !present.Add(effect.Name)) continue;
                HapticVolume volume = Placed(effect, GameObject.Find(effect.Name)).AddComponent<HapticVolume>();
                volume.Effect = effect.Name;
                volume.Shape = effect.Shape;
                volume.HalfSegment = effect.HalfSegment;
                Undo.RegisterCreatedObjectUndo(volume.gameObject, Name);
                created.Add(volume);
            }
            return created;
        }

        static GameObject Placed(Effect effect, GameObject parent)
        {
            Matrix4x4 matrix = Matrix4x4.identity;
            float[] rows = effect.Matrix;
            for (int row = 0; row < 3; row++)
                matrix.SetRow(row, new Vector4(rows[4 * row], rows[4 * row + 1], rows[4 * row + 2], rows[4 * row + 3]));
            matrix = HapticBody.ToUnity * matrix * HapticBody.ToUnity.inverse;
            GameObject created = new GameObject(effect.Name);
            created.transform.position = matrix.GetColumn(3);
            created.transform.rotation = matrix.rotation;
            created.transform.localScale = matrix.lossyScale;
            if (parent != null) created.transform.SetParent(parent.transform, true); // it stays where it is in the world
            return created;
        }
    }
}
