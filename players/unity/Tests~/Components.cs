// SPDX-License-Identifier: MIT
using System;
using System.IO;
using System.Reflection;
using Hfx.Haptics;
using UnityEngine;
using UnityEngine.XR;

/// <summary>
/// The sample, with its player and controllers, as Unity would call them: they play, make no garbage, and are
/// silent while the game is paused or has lost its focus.
/// </summary>
static class Components
{
    public static bool Play(string path)
    {
        HapticClipAsset asset = ScriptableObject.CreateInstance<HapticClipAsset>();
        asset.SetBytes(File.ReadAllBytes(path));
        GameObject garage = new GameObject();
        var sample = garage.AddComponent<Hfx.Haptics.Samples.Garage>();
        typeof(Hfx.Haptics.Samples.Garage).GetField("clip", BindingFlags.Instance | BindingFlags.NonPublic).SetValue(sample, asset);
        GameObject.Call(sample, "Start");
        HapticPlayer player = (HapticPlayer)garage.components[1];
        Action frame = (Action)Delegate.CreateDelegate(typeof(Action), player, "Update");
        long grown = Grown(frame);
        bool plays = player.IsPlaying && InputDevice.strongest > 0.1f && garage.transform.all.Count == player.Clip.Actuators.Length;
        player.Gain = 4.0f;
        player.Pause(true);
        bool isPaused = IsSilent(player, frame);
        GameObject.Call(player, "OnApplicationFocus", false);
        GameObject.Call(player, "OnApplicationFocus", true);
        bool staysPaused = IsSilent(player, frame); // the player's own pause outlasts a lost focus
        player.Pause(false);
        bool goesOn = !IsSilent(player, frame);
        GameObject.Call(player, "OnApplicationFocus", false);
        bool isAway = IsSilent(player, frame);
        GameObject.Call(player, "OnApplicationFocus", true);
        Time.timeScale = 0.0f;
        bool standsStill = IsSilent(player, frame);
        Time.timeScale = 1.0f;
        player.Loop = false;
        player.Speed = 2.0f;
        player.Play();
        double after = player.Clip.Seconds / 2.0;
        int frames = 0;
        for (; player.IsPlaying; frames++) frame();
        bool isTwiceAsFast = Math.Abs(frames - after / Time.deltaTime) < 2.0 && player.Position == player.Clip.Seconds;
        player.Loop = true;
        player.Play("nothing");
        bool isSilent = !player.IsPlaying && IsSilent(player, frame);
        player.Play();
        bool keeps = player.Loop && player.Speed == 2.0f && player.Gain == 4.0f && !IsSilent(player, frame);
        player.Asset = null;
        bool hasOutputs = HasOutputs(asset);
        bool isEmpty = player.Clip == null && !player.IsPlaying && InputDevice.amplitude == 0.0f;
        bool[] held = { grown < 1000, plays, isPaused, staysPaused, goesOn, isAway, standsStill, isTwiceAsFast, isSilent, keeps, hasOutputs, isEmpty };
        int fault = Array.IndexOf(held, false);
        if (fault >= 0) Console.WriteLine("the sample's demand " + fault + " is not held (" + grown + " bytes of garbage)");
        return fault < 0;
    }

    /// <summary>
    /// Without a headset the gamepad plays the strongest actuator of each side, and of no side on both motors; the
    /// phone plays, too. The component chooses the player of its object.
    /// </summary>
    static bool HasOutputs(HapticClipAsset asset)
    {
        GameObject game = new GameObject();
        HapticPlayer player = game.AddComponent<HapticPlayer>();
        player.Asset = asset;
        ControllerHaptics controllers = game.AddComponent<ControllerHaptics>();
        GameObject.Call(controllers, "Reset");
        controllers.VibratesPhone = true;
        GameObject.Call(controllers, "OnDisable");
        GameObject.Call(controllers, "OnEnable");
        InputDevice.isConnected = false;
        Action frame = (Action)Delegate.CreateDelegate(typeof(Action), player, "Update");
        bool isRight = controllers.Player == player;
        int different = 0;
        for (player.Play(); player.IsPlaying; Time.unscaledTime += Time.deltaTime)
        {
            frame();
            float low = Strongest(player, Side.Right), high = Strongest(player, Side.Left);
#if HFX_INPUT_SYSTEM
            var gamepad = UnityEngine.InputSystem.Gamepad.current;
            isRight &= player.IsPlaying ? gamepad.low == low && gamepad.high == high : gamepad.low == 0.0f;
#endif
            if (low != high) different++;
        }
#if UNITY_ANDROID
        isRight &= AndroidJNI.pulses > 20;
        AndroidJNI.pulses = 0;
        AndroidJNI.strongest = 0;
#endif
        GameObject.Call(controllers, "OnDisable");
        InputDevice.isConnected = true;
        return isRight && different > 20;
    }

    /// <summary>Share of the strongest vibration on any side but one.</summary>
    static float Strongest(HapticPlayer player, Side but)
    {
        float strongest = 0.0f;
        foreach (Actuator actuator in player.Clip.Actuators)
            if (actuator.Modality == Modality.Vibration && actuator.Side != but)
                strongest = Math.Max(strongest, (float)(player.Values[actuator.FirstColumn] / player.Clip.Columns[actuator.FirstColumn].Highest));
        return strongest;
    }

    static long Grown(Action frame)
    {
        frame();
        long before = GC.GetTotalMemory(true);
        for (int k = 0; k < 20000; k++) frame();
        return GC.GetTotalMemory(false) - before;
    }

    /// <summary>Whether nothing is felt in a second.</summary>
    static bool IsSilent(HapticPlayer player, Action frame)
    {
        InputDevice.strongest = 0.0f;
        for (int k = 0; k < 200; k++) frame();
        return InputDevice.strongest == 0.0f;
    }
}
