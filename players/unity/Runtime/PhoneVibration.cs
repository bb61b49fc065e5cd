// SPDX-License-Identifier: MIT
#if UNITY_ANDROID && !UNITY_EDITOR
using System;
using UnityEngine;
#endif

namespace Hfx.Haptics
{
    /// <summary>
    /// Pulses of an Android phone (8 or newer), with amplitude; nothing elsewhere. Unity's own Handheld.Vibrate has
    /// none. Makes no garbage after the first.
    /// </summary>
    static class PhoneVibration
    {
#if UNITY_ANDROID && !UNITY_EDITOR
        const long Milliseconds = 70;

        static IntPtr vibrator, effects, vibrate, oneShot;
        static readonly jvalue[] Pulse = new jvalue[2], Effect = new jvalue[1];
        static bool isKnown;

        /// <summary>Vibrates for a moment, with an amplitude of above 0 to 1.</summary>
        public static void Play(float share)
        {
            if (!isKnown) Find();
            if (vibrator == IntPtr.Zero) return;
            Pulse[0].j = Milliseconds;
            Pulse[1].i = Math.Max((int)(255.0f * share + 0.5f), 1);
            Effect[0].l = AndroidJNI.CallStaticObjectMethod(effects, oneShot, Pulse);
            AndroidJNI.CallVoidMethod(vibrator, vibrate, Effect);
            AndroidJNI.DeleteLocalRef(Effect[0].l);
        }

        static void Find()
        {
            isKnown = true;
            using (AndroidJavaClass player = new AndroidJavaClass("com.unity3d.player.UnityPlayer"))
            using (AndroidJavaObject activity = player.GetStatic<AndroidJavaObject>("currentActivity"))
            using (AndroidJavaObject service = activity.Call<AndroidJavaObject>("getSystemService", "vibrator"))
            using (AndroidJavaClass effect = new AndroidJavaClass("android.os.VibrationEffect"))
            {
                if (service == null) return;
                effects = AndroidJNI.NewGlobalRef(effect.GetRawClass());
                oneShot = AndroidJNI.GetStaticMethodID(effects, "createOneShot", "(JI)Landroid/os/VibrationEffect;");
                vibrate = AndroidJNI.GetMethodID(service.GetRawClass(), "vibrate", "(Landroid/os/VibrationEffect;)V");
                vibrator = AndroidJNI.NewGlobalRef(service.GetRawObject());
            }
        }
#else
        public static void Play(float share) { }
#endif
    }
}
