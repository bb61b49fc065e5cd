// SPDX-License-Identifier: MIT
using UnityEngine;
using UnityEngine.XR;

namespace Hfx.Haptics
{
    /// <summary>
    /// Plays the vibrations of a haptic player on the two controllers of a headset. Actuators worn on the
    /// left go to the left controller, those on the right to the right one; of several the strongest counts.
    /// </summary>
    [AddComponentMenu("Haptics/Controller Haptics")]
    public sealed class ControllerHaptics : MonoBehaviour
    {
        [SerializeField] HapticPlayer player;
        /// <summary>Id of a device in the clip (say oculus_touch); empty: all devices.</summary>
        [SerializeField] string device = "";

        bool isLeftOn, isRightOn;

        void OnEnable()
        {
            if (player != null) player.ValuesChanged += Play;
        }

        void OnDisable()
        {
            if (player != null) player.ValuesChanged -= Play;
            Send(XRNode.LeftHand, 0.0f, 0.0f, ref isLeftOn);
            Send(XRNode.RightHand, 0.0f, 0.0f, ref isRightOn);
        }

        void Play(HapticPlayer source)
        {
            float left = 0.0f, right = 0.0f, leftSeconds = 0.0f, rightSeconds = 0.0f;
            HapticClip clip = source.Clip;
            foreach (Device each in clip.Devices)
            {
                if (device.Length > 0 && each.Id != device) continue;
                for (int k = each.FirstActuator; k < each.FirstActuator + each.Actuators; k++)
                {
                    Actuator actuator = clip.Actuators[k];
                    if (actuator.Modality != Modality.Vibration) continue;
                    Column strength = clip.Columns[actuator.FirstColumn];
                    float share = (float)(source.Values[actuator.FirstColumn] / strength.Highest);
                    if (actuator.Side == Side.Left && share > left)
                    {
                        left = share;
                        leftSeconds = (float)each.DeadManSeconds;
                    }
                    else if (actuator.Side == Side.Right && share > right)
                    {
                        right = share;
                        rightSeconds = (float)each.DeadManSeconds;
                    }
                }
            }
            Send(XRNode.LeftHand, left, leftSeconds, ref isLeftOn);
            Send(XRNode.RightHand, right, rightSeconds, ref isRightOn);
        }

        static void Send(XRNode node, float amplitude, float seconds, ref bool isOn)
        {
            if (amplitude <= 0.0f && !isOn) return;
            InputDevice controller = InputDevices.GetDeviceAtXRNode(node);
            isOn = amplitude > 0.0f;
            if (!controller.isValid) return;
            if (isOn) controller.SendHapticImpulse(0, amplitude, seconds);
            else controller.StopHaptics();
        }
    }
}
