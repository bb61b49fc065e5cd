// SPDX-License-Identifier: MIT
using System;
using System.Globalization;
using System.IO;
using System.Reflection;
using Hfx.Haptics;
using UnityEngine;
using UnityEngine.XR;

/// <summary>
/// Strokes over the surfaces of players/conformance/surfaces, and a <see cref="HapticSurface"/> under a pointer, on a
/// controller, a gamepad and a phone.
/// </summary>
static class Surfaces
{
    static int wrong;

    /// <summary>Returns the number of wrong values.</summary>
    public static int Play(string folder)
    {
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(Path.Combine(folder, "strokes.hfxclip")));
        Strokes(asset.Clip, File.ReadAllLines(Path.Combine(folder, "strokes.txt")));
        Touch(asset);
        Sample();
        return wrong;
    }

    static void Strokes(HapticClip clip, string[] lines)
    {
        SurfaceStroke stroke = new SurfaceStroke(clip);
        int compared = 0;
        foreach (string line in lines)
        {
            string[] words = line.Split(' ');
            if (words[0] == "surface")
            {
                stroke.Surface = clip.Surfaces[int.Parse(words[1])];
                stroke.Lift();
                continue;
            }
            stroke.Feel(Number(words[1]), Number(words[2]), -1.0, Number(words[3]));
            compared++;
            Check(Math.Abs(stroke.Amplitude - Number(words[5])) <= stroke.Surface.HighestAmplitude / 255.0, line);
            Check(words.Length < 7 || Math.Abs(stroke.FrequencyHz - Number(words[6])) <= 1.0, line);
        }
        Check(compared > 700, "strokes: " + compared);
    }

    static void Touch(HapticClipAsset asset)
    {
        HapticSurface surface = new GameObject().AddComponent<HapticSurface>();
        surface.Asset = asset;
        surface.Surface = "Pad 0";
        surface.Controller = HapticSurface.Hand.Right;
        surface.VibratesGamepad = surface.VibratesPhone = true;
        InputDevice.amplitude = InputDevice.strongest = 0.0f;
        Action frame = (Action)Delegate.CreateDelegate(typeof(Action), surface, "LateUpdate");
        Rect area = new Rect(100.0f, 50.0f, 200.0f, 100.0f);
        frame();
        surface.Touch(new Vector2(150.0f, 75.0f), area);
        frame();
        Check(surface.Amplitude == 0.0f && InputDevice.strongest == 0.0f, "a touch begins silent");
        surface.Touch(new Vector2(250.0f, 75.0f), area);
        frame();
        SurfaceStroke same = new SurfaceStroke(asset.Clip) { Surface = asset.Clip.Surfaces[0] };
        same.Feel(0.25, 0.25, -1.0, 0.01);
        same.Feel(0.75, 0.25, -1.0, 0.01);
        Check(same.Amplitude > 0.0f && surface.Amplitude == same.Amplitude, "a path is felt: " + surface.Amplitude);
        Check(Math.Abs(InputDevice.amplitude - Math.Min(same.Amplitude / 12.75f, 1.0f)) < 1e-6, "the controller plays");
        for (int k = 0; k < 20; k++) frame();
        Check(InputDevice.amplitude == 0.0f, "a pointer that stands is silent");
        RaycastHit hit = new RaycastHit { textureCoord = new Vector2(0.2f, 0.9f) };
        surface.Touch(hit);
        frame();
        Check(InputDevice.amplitude > 0.0f, "a hit is felt");
#if HFX_INPUT_SYSTEM
        float low = UnityEngine.InputSystem.Gamepad.current.low, high = UnityEngine.InputSystem.Gamepad.current.high;
        Check(Math.Abs(low + high - InputDevice.amplitude) < 1e-6, "the gamepad plays");
#endif
#if UNITY_ANDROID
        Check(AndroidJNI.pulses >= 2 && AndroidJNI.strongest > 0 && AndroidJNI.strongest <= 255, "the phone plays");
#endif
        GameObject.Call(surface, "OnApplicationFocus", false);
        Check(InputDevice.amplitude == 0.0f, "a lost focus is silent");
        surface.Touch(hit);
        frame();
        GameObject.Call(surface, "OnApplicationFocus", true);
        Check(InputDevice.amplitude == 0.0f && surface.Amplitude == 0.0f, "away, nothing is felt");
        Collider collider = new Collider();
        Check(surface.Point(new Ray { place = new Vector2(0.1f, 0.1f) }, collider), "a ray hits");
        Check(!surface.Point(new Ray { place = new Vector2(1.5f, 0.1f) }, collider), "a ray misses");
        long grown = Garbage(surface, frame);
        Check(grown < 1000, "the surface makes garbage: " + grown);
        GameObject.Call(surface, "OnDisable");
        Check(InputDevice.amplitude == 0.0f, "disabled, it is silent");
    }

    /// <summary>A drag over each square of the sample's board, with its clip where that lies beside the tests.</summary>
    static void Sample()
    {
        const string Clip = "Samples~/Board/board.hfxclip";
        if (!File.Exists(Clip)) return;
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(Clip));
        GameObject there = new GameObject("Board");
        var board = there.AddComponent<Hfx.Haptics.Samples.Board>();
        typeof(Hfx.Haptics.Samples.Board).GetField("clip", BindingFlags.Instance | BindingFlags.NonPublic).SetValue(board, asset);
        GameObject.Call(board, "Start");
        HapticSurface surface = there.GetComponent<HapticSurface>();
        Check(asset.Clip.Surfaces.Length == 16, "16 squares");
        foreach (Surface each in asset.Clip.Surfaces)
        {
            Physics.before = GameObject.Find(each.Name).GetComponent<Collider>();
            UnityEngine.Input.isPressed = true;
            SurfaceStroke same = new SurfaceStroke(asset.Clip) { Surface = each };
            float across = each.UvWidthMm / each.WidthMm, up = each.UvHeightMm / each.HeightMm;
            for (int k = 0; k < 3; k++)
            {
                UnityEngine.Input.mousePosition = new Vector3(0.2f + 0.3f * k, 0.5f, 0.0f);
                GameObject.Call(board, "Update");
                GameObject.Call(surface, "LateUpdate");
                same.Feel((0.2f + 0.3f * k) * across, 0.5f * up, -1.0, 0.01);
            }
            Check(surface.Surface == each.Name && surface.Amplitude > 0.0f, each.Name + " is felt");
            Check(Math.Abs(surface.Amplitude - same.Amplitude) < 1e-3 * same.Amplitude, each.Name + " is to scale");
        }
        UnityEngine.Input.isPressed = false;
        GameObject.Call(board, "Update");
        Check(surface.Amplitude == 0.0f, "lifted, the board is silent");
    }

    static long Garbage(HapticSurface surface, Action frame)
    {
        long before = 0;
        for (int k = 0; k < 20001; k++)
        {
            if (k == 1) before = GC.GetTotalMemory(true);
            surface.Touch(new Vector2(0.001f * (k % 997), 0.5f));
            frame();
        }
        return GC.GetTotalMemory(false) - before;
    }

    static double Number(string text) { return double.Parse(text, CultureInfo.InvariantCulture); }

    static void Check(bool holds, string fault)
    {
        if (holds) return;
        if (wrong++ < 10) Console.WriteLine("surfaces: " + fault);
    }
}
