// SPDX-License-Identifier: MIT
using UnityEngine;

namespace Hfx.Haptics.Samples
{
    /// <summary>
    /// Plays the garage of HFX's demo on the controllers and shows each actuator as a bar. Add it to an
    /// empty object of any scene with a camera, choose the clip beside this file, and press Play.
    /// </summary>
    [AddComponentMenu("Haptics/Samples/Garage")]
    public sealed class Garage : MonoBehaviour
    {
        const float Width = 0.04f, Height = 0.6f; // metres

        [SerializeField] HapticClipAsset clip;

        Transform[] bars;

        void Start()
        {
            HapticPlayer player = gameObject.AddComponent<HapticPlayer>();
            player.Asset = clip;
            player.Loop = true;
            player.ValuesChanged += Show;
            gameObject.AddComponent<ControllerHaptics>().Player = player;
            if (player.Clip == null) return; // Play says so
            bars = new Transform[player.Clip.Actuators.Length];
            for (int k = 0; k < bars.Length; k++)
            {
                GameObject bar = GameObject.CreatePrimitive(PrimitiveType.Cube);
                bar.name = player.Clip.Actuators[k].Id;
                bars[k] = bar.transform;
                bars[k].SetParent(transform, false);
            }
            player.Play();
        }

        void Show(HapticPlayer player)
        {
            for (int k = 0; k < bars.Length; k++)
            {
                int index = player.Clip.Actuators[k].FirstColumn;
                Column column = player.Clip.Columns[index];
                float away = Mathf.Abs((float)(player.Values[index] - column.Neutral));
                float most = Mathf.Max((float)(column.Highest - column.Neutral), (float)(column.Neutral - column.Lowest));
                float height = Mathf.Max(Height * away / most, 0.005f);
                bars[k].localScale = new Vector3(Width, height, Width);
                bars[k].localPosition = new Vector3((k - 0.5f * (bars.Length - 1)) * 1.25f * Width, 0.5f * height, 2.0f);
            }
        }
    }
}
