// SPDX-License-Identifier: MIT
using System.Collections.Generic;
using UnityEditor;
using UnityEngine;

namespace Hfx.Haptics.Editor
{
    /// <summary>Drop-down of the volume effects that a <see cref="HapticVolume"/> can have.</summary>
    [CustomPropertyDrawer(typeof(EffectNameAttribute))]
    public sealed class EffectNameDrawer : PropertyDrawer
    {
        const string None = "(none)";

        public override void OnGUI(Rect position, SerializedProperty property, GUIContent label)
        {
            List<string> names = Known();
            if (names.Count == 0)
            {
                EditorGUI.PropertyField(position, property, label);
                return;
            }
            // A name that no clip has stays, and is shown.
            string[] shown = Choices(names, property.stringValue);
            int chosen = System.Array.IndexOf(shown, property.stringValue.Length > 0 ? property.stringValue : None);
            int other = EditorGUI.Popup(position, label.text, chosen, System.Array.ConvertAll(shown, name => name.Replace("/", "\u2215")));
            if (other != chosen) property.stringValue = shown[other] == None ? "" : shown[other];
        }

        /// <summary>What the drop-down shows for a name: it is among it, known or not.</summary>
        public static string[] Choices(List<string> names, string present)
        {
            List<string> shown = new List<string> { None };
            shown.AddRange(names);
            if (present.Length > 0 && !names.Contains(present)) shown.Add(present);
            return shown.ToArray();
        }

        /// <summary>Volume effects of the bodies in the open scenes; without a clip there, of all clips of the project.</summary>
        public static List<string> Known()
        {
            List<string> names = new List<string>();
            foreach (HapticBody body in Object.FindObjectsOfType<HapticBody>()) Add(body.EffectClip, names);
            if (names.Count > 0) return names;
            foreach (string guid in AssetDatabase.FindAssets("t:HapticClipAsset"))
            {
                HapticClipAsset asset = AssetDatabase.LoadAssetAtPath<HapticClipAsset>(AssetDatabase.GUIDToAssetPath(guid));
                if (asset != null) Add(asset.Clip, names);
            }
            return names;
        }

        static void Add(HapticClip clip, List<string> names)
        {
            if (clip == null) return;
            foreach (Effect effect in clip.Effects)
                if (!effect.IsPainted && !names.Contains(effect.Name)) names.Add(effect.Name);
        }
    }
}
