// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Reflection;
using Hfx.Haptics;
using UnityEngine;

/// <summary>
/// A <see cref="HapticBody"/> on an avatar that walks as players/conformance/spatial says: what it feels is
/// what the file says, within 1/255. The avatar's bones have axes of their own, as any engine's.
/// </summary>
static class Spatial
{
    static readonly Random Dice = new Random(3);
    static readonly string[] Side = "-1 0 0 0 0 0 1 0 0 -1 0 0".Split(' '); // (-x, z, -y), as the page says

    public static int Walk(string folder, ref int wrong)
    {
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(Path.Combine(folder, "walk.hfxclip")));
        Bone[] bones = asset.Clip.Bodies[0].Bones;
        HapticBody body = new HapticBody { transform = new Transform { localToWorldMatrix = Axes() } };
        Matrix4x4[] rest = new Matrix4x4[bones.Length];
        for (int k = 0; k < bones.Length; k++)
        {
            rest[k] = Axes();
            Matrix4x4 placed = body.transform.localToWorldMatrix * rest[k];
            body.transform.all.Add(new Transform { name = bones[k].Name, localToWorldMatrix = placed });
        }
        List<HapticVolume> volumes = new List<HapticVolume>();
        foreach (Effect each in asset.Clip.Effects)
        {
            volumes.Add(new HapticVolume { Effect = each.Name, transform = new Transform() });
            Call(volumes[volumes.Count - 1], "OnEnable");
            Call(volumes[volumes.Count - 1], "OnDrawGizmos");
        }
        Set(body, "clip", asset);
        Call(body, "Awake");
        Call(body, "OnEnable");
        Matrix4x4 toUnity = Matrix(Side, 0), back = toUnity.inverse;
        int felt = 0;
        foreach (string line in File.ReadAllLines(Path.Combine(folder, "walk.txt")))
        {
            string[] words = line.Split(' ');
            if (words[0] == "bone")
            {
                int k = int.Parse(words[1]);
                body.transform.all[k].localToWorldMatrix = toUnity * Matrix(words, 2) * back * rest[k];
            }
            else if (words[0] == "volume")
            {
                HapticVolume volume = volumes[int.Parse(words[1])];
                volume.Level = (float)Number(words[2]);
                volume.transform.localToWorldMatrix = toUnity * Matrix(words, 3) * back;
            }
            else if (words[0] == "evaluate")
            {
                Time.deltaTime = (float)Number(words[1]);
                Call(body, "LateUpdate");
            }
            else felt += Compare(body, volumes, words, ref wrong);
        }
        if (Garbage(body.Core) > 1000 && wrong++ < 5) Console.WriteLine("the core makes garbage");
        foreach (HapticVolume volume in volumes) Call(volume, "OnDisable");
        Call(body, "OnDisable");
        Call(body, "OnDestroy");
        return felt;
    }

    static int Compare(HapticBody body, List<HapticVolume> volumes, string[] words, ref int wrong)
    {
        int effect = body.NumberOf(volumes[int.Parse(words[1])]), felt = 0;
        float[] found = body.Core.GetWeights(effect);
        double level = body.Core.GetLevel(effect);
        double[] expected = new double[found.Length];
        for (int k = 2; k < words.Length; k++)
        {
            string[] pair = words[k].Split(':');
            expected[int.Parse(pair[0])] = Number(pair[1]);
        }
        for (int k = 0; k < found.Length; k++)
        {
            if (found[k] * level > 0.0 || expected[k] > 0.0) felt++;
            if (Math.Abs(found[k] * level - expected[k]) <= 1.0 / 255.0) continue;
            if (wrong++ < 5) Console.WriteLine("effect " + effect + ", vertex " + k + ": " + found[k] * level + " instead of " + expected[k]);
        }
        return felt;
    }

    static long Garbage(LiveBody core)
    {
        float[] matrices = new float[12 * core.Body.Bones.Length], values = new float[core.Clip.Columns.Length], matrix = new float[12];
        core.Evaluate(0.01, values);
        long before = GC.GetTotalMemory(true);
        for (int k = 0; k < 500; k++)
        {
            core.SetBones(matrices);
            core.SetVolume(0, matrix);
            core.Trigger(0, 1.0);
            core.Evaluate(0.01, values);
        }
        return GC.GetTotalMemory(false) - before;
    }

    /// <summary>A random rotation about a random place.</summary>
    static Matrix4x4 Axes()
    {
        double a = 6.0 * Dice.NextDouble(), b = 6.0 * Dice.NextDouble();
        Matrix4x4 one = Matrix4x4.identity, other = Matrix4x4.identity;
        one.m00 = one.m11 = (float)Math.Cos(a);
        one.m10 = (float)Math.Sin(a);
        one.m01 = -one.m10;
        other.m11 = other.m22 = (float)Math.Cos(b);
        other.m21 = (float)Math.Sin(b);
        other.m12 = -other.m21;
        one.m03 = (float)Dice.NextDouble();
        one.m23 = (float)Dice.NextDouble();
        return one * other;
    }

    static Matrix4x4 Matrix(string[] words, int at)
    {
        double[,] found = new double[4, 4];
        for (int k = 0; k < 12; k++) found[k / 4, k % 4] = Number(words[at + k]);
        found[3, 3] = 1.0;
        return Matrix4x4.From(found);
    }

    static double Number(string text) { return double.Parse(text, CultureInfo.InvariantCulture); }

    static void Set(object of, string field, object value)
    {
        of.GetType().GetField(field, BindingFlags.NonPublic | BindingFlags.Instance).SetValue(of, value);
    }

    static void Call(object of, string method)
    {
        of.GetType().GetMethod(method, BindingFlags.NonPublic | BindingFlags.Instance).Invoke(of, null);
    }
}
