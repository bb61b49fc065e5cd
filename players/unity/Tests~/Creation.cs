// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.IO;
using Hfx.Haptics;
using Hfx.Haptics.Editor;
using UnityEditor;
using UnityEngine;

/// <summary>*Create Volumes from the Clip*: objects where the volumes are in the clip, below those of the same name.</summary>
static class Creation
{
    public static int Play(string path)
    {
        HapticClip clip = new HapticClip(File.ReadAllBytes(path));
        GameObject.all.Clear();
        GameObject present = new GameObject(clip.Effects[1].Name);
        Undo.steps = 0;
        List<HapticVolume> created = VolumeCreation.Create(clip);
        int wrong = 0;
        if (created.Count != clip.Effects.Length || Undo.steps != created.Count) wrong++;
        if (created[1].transform.parent != present.transform || created[0].transform.parent != null) wrong++;
        if (VolumeCreation.Create(clip).Count != 0) wrong++;
        for (int k = 0; k < created.Count; k++)
        {
            Effect effect = clip.Effects[k];
            HapticVolume volume = created[k];
            if (volume.Effect != effect.Name || volume.Shape != effect.Shape || volume.HalfSegment != effect.HalfSegment || volume.Level != 1.0f) wrong++;
            for (int axis = 0; axis < 4; axis++) // a point on each axis of the shape, and its centre
            {
                float[] point = { axis == 0 ? 1 : 0, axis == 1 ? 1 : 0, axis == 2 ? 1 : 0 }, m = effect.Matrix;
                float[] there = new float[3];
                for (int row = 0; row < 3; row++)
                    there[row] = m[4 * row] * point[0] + m[4 * row + 1] * point[1] + m[4 * row + 2] * point[2] + m[4 * row + 3];
                Vector3 away = Moved(volume.transform, ToUnity(point)) - ToUnity(there);
                if (Math.Abs(away.x) + Math.Abs(away.y) + Math.Abs(away.z) > 1e-4) wrong++;
            }
        }
        foreach (HapticVolume volume in created) GameObject.Call(volume, "OnDisable");
        wrong += Names(path);
        if (wrong > 0) Console.WriteLine("created volumes: " + wrong + " wrong");
        return wrong;
    }

    /// <summary>The drop-down of effects: of the project's clips, then of the body in the scene; an unknown name stays.</summary>
    static int Names(string path)
    {
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(path));
        EffectNameDrawer drawer = new EffectNameDrawer();
        SerializedProperty property = new SerializedProperty { stringValue = "Old name" };
        GameObject.all.Clear();
        AssetDatabase.assets.Clear();
        EditorGUI.picked = -1;
        drawer.OnGUI(new Rect(), property, new GUIContent());
        int wrong = EditorGUI.shown == null && property.stringValue == "Old name" ? 0 : 1; // no clip: a text
        AssetDatabase.assets["clip"] = asset;
        drawer.OnGUI(new Rect(), property, new GUIContent());
        if (EditorGUI.shown[0] != "(none)" || EditorGUI.shown[1] != "Volume 0" || EditorGUI.shown.Length != 10) wrong++;
        if (EditorGUI.shown[9] != "Old name" || property.stringValue != "Old name") wrong++;
        EditorGUI.picked = 2;
        drawer.OnGUI(new Rect(), property, new GUIContent());
        if (property.stringValue != "Volume 1") wrong++;
        EditorGUI.picked = 0;
        drawer.OnGUI(new Rect(), property, new GUIContent());
        if (property.stringValue != "") wrong++;
        EditorGUI.picked = -1;
        HapticClipAsset library = ScriptableObject.CreateInstance<HapticClipAsset>();
        library.SetBytes(File.ReadAllBytes(path.Replace("spatial", "behaviour").Replace("walk", "library")));
        HapticBody body = new GameObject().AddComponent<HapticBody>();
        body.Asset = asset;
        body.EffectAsset = library;
        drawer.OnGUI(new Rect(), property, new GUIContent());
        if (string.Join(",", EditorGUI.shown) != "(none),Ball") wrong++; // what the body feels
        GameObject.Call(body, "OnDisable");
        AssetDatabase.assets.Clear();
        GameObject.all.Clear();
        return wrong;
    }

    static Vector3 ToUnity(float[] of) { return new Vector3(-of[0], of[2], -of[1]); }

    static Vector3 Moved(Transform by, Vector3 of)
    {
        Vector3 size = by.localScale;
        return of.x * size.x * by.rotation.x + of.y * size.y * by.rotation.y + of.z * size.z * by.rotation.z + by.position;
    }
}
