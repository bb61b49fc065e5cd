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
        if (wrong > 0) Console.WriteLine("created volumes: " + wrong + " wrong");
        return wrong;
    }

    static Vector3 ToUnity(float[] of) { return new Vector3(-of[0], of[2], -of[1]); }

    static Vector3 Moved(Transform by, Vector3 of)
    {
        Vector3 size = by.localScale;
        return of.x * size.x * by.rotation.x + of.y * size.y * by.rotation.y + of.z * size.z * by.rotation.z + by.position;
    }
}
