// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using Hfx.Haptics;
using UnityEngine;

/// <summary>Plays the calls of players/conformance/behaviour and compares what is expected of each.</summary>
static class Behaviour
{
    /// <summary>The number of lines that are wrong.</summary>
    public static int Play(string folder)
    {
        int wrong = Play(Path.Combine(folder, "behaviour.txt"), Path.Combine(folder, "behaviour.hfxclip"), 80);
        wrong += Play(Path.Combine(folder, "placed.txt"), Path.Combine(folder, "ring.hfxclip"), 40);
        return wrong + Follow(Path.Combine(folder, "behaviour.hfxclip"));
    }

    static int Play(string script, string path, int least)
    {
        HapticClip clip = new HapticClip(File.ReadAllBytes(path));
        ClipPlayer player = null;
        float[] values = new float[clip.Columns.Length];
        int wrong = 0, compared = 0;
        foreach (string line in File.ReadAllLines(script))
        {
            if (line.Length == 0 || line[0] == '#') continue;
            string[] sides = line.Split('='), call = sides[0].Trim().Split(new[] { ' ' }, 2);
            string argument = call.Length > 1 ? call[1] : "", expected = sides.Length > 1 ? sides[1].Trim() : null;
            string found = null;
            switch (call[0])
            {
                case "open": player = new ClipPlayer(clip); break;
                case "play": found = player.Play(argument) ? "1" : "0"; break;
                case "stop": player.Stop(); break;
                case "seek": player.Seek(Number(argument)); break;
                case "gain": player.Gain = Number(argument); break;
                case "loop": player.Loops = argument == "1"; break;
                case "pause": player.IsPaused = argument == "1"; break;
                case "playing": found = player.IsPlaying ? "1" : "0"; break;
                case "position": found = Math.Abs(player.Position - Number(expected)) < 1e-6 ? expected : player.Position.ToString(); break;
                case "devices": found = Devices(clip, argument); break;
                case "parameter":
                    string[] words = argument.Split(' ');
                    bool isThere = player.SetParameter(words[0], Number(words[1]));
                    if (isThere == (expected == null)) break;
                    found = isThere + "";
                    expected = expected ?? "";
                    break;
                case "place":
                    double[] place = Array.ConvertAll(argument.Split(' '), Number);
                    player.Place(place[0], place[1], place[2]);
                    break;
                case "advance":
                    player.Advance(Number(argument), values);
                    found = Values(clip, values, expected);
                    break;
                default: found = "no such call"; break;
            }
            compared++;
            if (call[0] == "parameter" && found == null) continue;
            if (found == expected) continue;
            wrong++;
            Console.WriteLine("behaviour: " + line + ": " + found);
        }
        return compared >= least ? wrong : wrong + 1;
    }

    /// <summary>Effects of a library on the body of another clip, by the compiled core.</summary>
    public static int Feel(string folder)
    {
        HapticClip avatar = new HapticClip(File.ReadAllBytes(Path.Combine(folder, "avatar.hfxclip")));
        HapticClip library = new HapticClip(File.ReadAllBytes(Path.Combine(folder, "library.hfxclip")));
        LiveBody body = null;
        float[] values = new float[avatar.Columns.Length];
        int wrong = 0, compared = 0;
        foreach (string line in File.ReadAllLines(Path.Combine(folder, "effects.txt")))
        {
            if (line.Length == 0 || line[0] == '#') continue;
            string[] sides = line.Split('='), words = sides[0].Trim().Split(' ');
            string expected = sides.Length > 1 ? sides[1].Trim() : null, found = null;
            compared++;
            if (words[0] == "open")
            {
                body = new LiveBody(avatar, 0, library);
                if (!body.SetBones(Sphere(0.0f, 0.0f, 0.0f, 1.0f))) wrong++;
                continue;
            }
            if (words[0] == "evaluate")
            {
                body.Evaluate(Number(words[1]), values);
                found = Values(avatar, values, expected);
            }
            else
            {
                int effect = Array.FindIndex(library.Effects, each => each.Name == words[1]);
                float[] numbers = Array.ConvertAll(words, word => { float number; return float.TryParse(word, NumberStyles.Float, CultureInfo.InvariantCulture, out number) ? number : 0.0f; });
                bool isDone = true;
                if (words[0] == "add") effect = body.AddVolume(effect);
                if (words[0] == "trigger") isDone = body.Trigger(effect, numbers[2]);
                else if (words[0] == "place") isDone = body.Place(effect, numbers[2], numbers[3], numbers[4]);
                else isDone = body.SetVolume(effect, Sphere(numbers[2], numbers[3], numbers[4], numbers[5])) && body.Trigger(effect, 1.0);
                found = isDone ? "1" : "0";
            }
            if (found == expected) continue;
            wrong++;
            Console.WriteLine("effects: " + line + ": " + found);
        }
        body.Dispose();
        return compared > 20 ? wrong : wrong + 1;
    }

    static float[] Sphere(float x, float y, float z, float radius) { return new[] { radius, 0, 0, x, 0, radius, 0, y, 0, 0, radius, z }; }

    /// <summary>
    /// Follows an animator: rows of 0.1 s have 1 to 10 at the first column; Strike is 0.2 to 0.5 s. In the state Strike,
    /// 0.3 s long, at its turns; in another state, 2 s long, which loops, and which is longer than the clip.
    /// </summary>
    static int Follow(string path)
    {
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(path));
        HapticPlayer player = new GameObject().AddComponent<HapticPlayer>();
        Animator animator = new Animator();
        player.Asset = asset;
        player.Follow = animator;
        int wrong = 0;
        foreach (string moment in new[]
        {
            "Strike 0.3 0 0 3", "Strike 0.3 0 0.15 3", "Strike 0.3 0 0.5 4", "Strike 0.3 0 1.2 5", "Strike 0.3 0 1.3 0",
            "Strike 0.3 0 0.5 4", // set back by the game
            "Strike 0.3 1 1.1 5", "Strike 0.3 1 1.2 3", // it loops: from 0.35 over 0.5 to 0.23, 0.26 s
            "Walk 2 1 0.125 3", "Walk 2 1 0.4 9", "Walk 2 1 0.6 10", "Walk 2 1 0.7 0", "Walk 2 1 1.1 3", // no jump is felt, and none is lost
        })
        {
            string[] words = moment.Split(' ');
            animator.state = new AnimatorStateInfo
            {
                shortNameHash = Animator.StringToHash(words[0]), length = (float)Number(words[1]), loop = words[2] == "1",
                normalizedTime = (float)Number(words[3]),
            };
            GameObject.Call(player, "Update");
            GameObject.Call(player, "LateUpdate");
            if (Math.Abs(player.Values[0] - Number(words[4])) < 0.01) continue;
            wrong++;
            Console.WriteLine("followed: " + moment + ": " + player.Values[0]);
        }
        animator.speed = 0.0f;
        GameObject.Call(player, "LateUpdate");
        if (player.Values[0] != 0.0f && wrong++ < 9) Console.WriteLine("an animator that stands still is felt");
        return wrong;
    }

    static string Devices(HapticClip clip, string name)
    {
        List<string> found = new List<string>();
        for (int k = 0; k < clip.Devices.Length; k++) if (clip.Devices[k].IsNamed(name)) found.Add(k.ToString());
        return string.Join(" ", found.ToArray());
    }

    /// <summary>What is expected, if the values are within twice 1/65535 of full scale (of a gain of 2).</summary>
    static string Values(HapticClip clip, float[] values, string expected)
    {
        string[] words = expected.Split(' ');
        bool isRight = words.Length == values.Length;
        for (int k = 0; k < values.Length && isRight; k++)
        {
            double slack = 2.0 * (clip.Columns[k].Highest - clip.Columns[k].Lowest) / 65535.0 + 1e-6;
            isRight = Math.Abs(values[k] - Number(words[k])) <= slack;
        }
        return isRight ? expected : string.Join(" ", Array.ConvertAll(values, value => value.ToString(CultureInfo.InvariantCulture)));
    }

    static double Number(string text) { return text == "nan" ? double.NaN : double.Parse(text, CultureInfo.InvariantCulture); }
}
