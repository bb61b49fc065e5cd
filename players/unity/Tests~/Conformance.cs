// SPDX-License-Identifier: MIT
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using Hfx.Haptics;

/// <summary>
/// Plays players/conformance and compares each value; then every clip with one byte changed is refused, and
/// playing makes no garbage. With a second folder, say players/conformance/spatial, a body feels volumes by the
/// compiled core; with a clip of tests/players/small_clip.py, what a body does when things change. Ends with 1 if
/// anything is wrong.
/// </summary>
static class Conformance
{
    static int wrong, compared;

    static int Main(string[] arguments)
    {
        string[] paths = Directory.GetFiles(arguments[0], "*.hfxclip");
        foreach (string path in paths) Play(path);
        wrong += Behaviour.Play(Path.Combine(arguments[0], "behaviour"));
        wrong += Surfaces.Play(Path.Combine(arguments[0], "surfaces"));
        int damaged = 0;
        foreach (string path in paths) damaged += Damage(path);
        foreach (string path in paths) Garbage(path);
        Check(Components.Play(paths[0].Replace(Path.GetFileName(paths[0]), "touch.hfxclip")), "components");
        int felt = 0;
        if (arguments.Length > 1) felt = Spatial.Walk(arguments[1], ref wrong);
        if (arguments.Length > 1) wrong += Behaviour.Feel(Path.Combine(arguments[0], "behaviour"));
        if (arguments.Length > 1) wrong += Creation.Play(Path.Combine(arguments[1], "walk.hfxclip"));
        if (arguments.Length > 2) wrong += Bodies.Play(arguments[2], arguments[1] + Path.DirectorySeparatorChar);
        Console.WriteLine(paths.Length + " clips, " + compared + " values compared, " + damaged + " damaged ones refused, " + felt + " weights felt, " + wrong + " wrong");
        return wrong > 0 || compared == 0 || (arguments.Length > 1 && felt == 0) ? 1 : 0;
    }

    static void Play(string path)
    {
        HapticClip clip = new HapticClip(File.ReadAllBytes(path));
        ClipPlayer player = new ClipPlayer(clip);
        Dictionary<string, double> factors = new Dictionary<string, double>();
        float[] found = new float[clip.Columns.Length];
        int number = 0;
        foreach (string line in File.ReadAllLines(path.Replace(".hfxclip", ".txt")))
        {
            number++;
            string[] sides = line.Split(new[] { " = " }, StringSplitOptions.None);
            string[] call = sides[0].Split(new[] { ' ' }, 2);
            string argument = call.Length > 1 ? call[1] : "";
            switch (call[0])
            {
                case "columns": Check(int.Parse(argument) == found.Length, path + ": columns"); break;
                case "play": player.Reset(); player.Play(); factors.Clear(); break;
                case "named": player.Reset(); Check(player.Play(argument), line); factors.Clear(); break;
                case "gain": player.Gain = Number(argument); break;
                case "loop": player.Loops = argument == "1"; break;
                case "pause": player.IsPaused = argument == "1"; break;
                case "stop": player.Stop(); break;
                case "seek": player.Seek(Number(argument)); break;
                case "parameter":
                    string[] words = argument.Split(' ');
                    factors[words[0]] = Number(words[1]);
                    Check(player.SetParameter(words[0], factors[words[0]]), line);
                    break;
                case "advance":
                case "silence":
                    if (call[0] == "silence") player.IsPaused = true;
                    player.Advance(argument == "" ? 0.0 : Number(argument), found);
                    Compare(player, found, sides[1].Split(' '), factors, path + ", line " + number);
                    break;
                default: Check(false, "unknown call: " + line); break;
            }
        }
    }

    static void Compare(ClipPlayer player, float[] found, string[] expected, Dictionary<string, double> factors, string place)
    {
        HashSet<int> strengths = new HashSet<int>();
        foreach (Actuator each in player.Clip.Actuators) strengths.Add(each.FirstColumn);
        for (int k = 0; k < found.Length; k++)
        {
            Column column = player.Clip.Columns[k];
            double scale;
            if (!factors.TryGetValue(column.Parameter, out scale)) scale = 1.0;
            if (strengths.Contains(k)) scale *= player.Gain;
            double slack = (column.Highest - column.Lowest) / 65535.0 * Math.Max(scale, 1.0)
                + 1e-6 * Math.Max(Math.Abs(column.Lowest), Math.Abs(column.Highest));
            compared++;
            Check(Math.Abs(found[k] - Number(expected[k])) <= slack, place + ", column " + k + ": " + found[k] + " instead of " + expected[k]);
        }
    }

    static int Damage(string path)
    {
        byte[] bytes = File.ReadAllBytes(path);
        Random random = new Random(1);
        int refused = 0;
        for (int k = 0; k < 20; k++)
        {
            byte[] other = (byte[])bytes.Clone();
            other[random.Next(20, bytes.Length)] ^= (byte)(1 << random.Next(8));
            if (k % 4 == 0) Array.Resize(ref other, random.Next(0, bytes.Length));
            try
            {
                new HapticClip(other);
                Check(false, path + ": a damaged clip was taken");
            }
            catch (FormatException)
            {
                refused++;
            }
        }
        return refused;
    }

    static void Garbage(string path)
    {
        HapticClip clip = new HapticClip(File.ReadAllBytes(path));
        ClipPlayer player = new ClipPlayer(clip);
        float[] values = new float[clip.Columns.Length];
        player.Play();
        player.Loops = true;
        player.Place(path.Length % 2 * 30.0, 0.0, 1.0); // every other clip is turned
        player.Advance(0.01, values);
        long before = GC.GetTotalMemory(true);
        int collections = GC.CollectionCount(0);
        for (int k = 0; k < 20000; k++) player.Advance(0.011, values);
        long grown = GC.GetTotalMemory(false) - before;
        Check(GC.CollectionCount(0) == collections && grown < 1000, path + ": " + grown + " bytes of garbage in 20,000 frames");
    }

    static double Number(string text) { return double.Parse(text, CultureInfo.InvariantCulture); }

    static void Check(bool holds, string fault)
    {
        if (holds) return;
        wrong++;
        if (wrong < 20) Console.WriteLine(fault);
    }
}
